//! Values of options, from their text.

/// A name with a number, `name=value`.
pub(super) fn key_value(text: &str) -> Result<(String, f64), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("`{text}`: expected name=value"))?;
    let value: f64 = value.trim().parse().map_err(|_| format!("`{value}` is not a number"))?;
    if !value.is_finite() {
        return Err(format!("`{value}` is not a finite number"));
    }
    Ok((key.trim().to_owned(), value))
}

/// A positive time in seconds, with or without its unit.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    let number = text.trim();
    let number = number.strip_suffix('s').unwrap_or(number).trim_end();
    match number.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err(format!("`{text}` is not a positive time in seconds, such as `10` or `10s`")),
    }
}
