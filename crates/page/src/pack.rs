//! Encodes numbers as text that is short and fast for a browser to read.
//!
//! Short lists stay JSON numbers. Matrices for computing ([`matrix`]) keep twelve digits. Long
//! lists become base64 of little-endian values, `{"$": "f4" | "i2", "b": …}`; `i2` has a step `"s"`
//! by which the integers are multiplied. Missing values are null in lists, NaN in `f4`, −32768 in
//! `i2`. Long text that the page needs only now and then is compressed ([`deflated`]).

use flate2::Compression;
use flate2::write::DeflateEncoder;
use serde_json::{Value, json};
use std::io::Write as _;

const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Lists shorter than this stay JSON numbers.
const SHORT: usize = 24;

/// The integer that stands for a missing value.
const MISSING: i16 = i16::MIN;

/// Base64 (RFC 4648, padded).
pub fn base64(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().enumerate().fold(0u32, |w, (i, b)| w | u32::from(*b) << (16 - 8 * i));
        for i in 0..4 {
            if i <= chunk.len() {
                out.push(char::from(DIGITS[(word >> (18 - 6 * i)) as usize & 63]));
            } else {
                out.push('=');
            }
        }
    }
    out
}

/// Base64 of a text compressed by DEFLATE (RFC 1951); `Numbers.inflated` of the page reads it.
pub fn deflated(text: &str) -> String {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    // none: a vector takes everything
    let written = encoder.write_all(text.as_bytes()).and_then(|()| encoder.finish());
    base64(&written.ok().unwrap_or_default())
}

/// One number with six significant digits; null if it is not finite.
pub fn number(value: f64) -> Value {
    if !value.is_finite() {
        return Value::Null;
    }
    format!("{value:.5e}").parse::<f64>().ok().map_or(Value::Null, |v| json!(v))
}

/// A list of numbers in single precision (seven digits).
pub fn numbers(values: &[f64]) -> Value {
    if values.len() < SHORT {
        return Value::Array(values.iter().map(|v| number(*v)).collect());
    }
    let bytes: Vec<u8> = values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect();
    json!({"$": "f4", "b": base64(&bytes)})
}

/// A list of numbers in multiples of `step`, or of a larger step if the largest number requires it.
pub fn steps(values: impl IntoIterator<Item = f64>, step: f64) -> Value {
    let values: Vec<f64> = values.into_iter().collect();
    let largest = values.iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(v.abs()));
    let step = step.max(largest / 32_767.0);
    let bytes: Vec<u8> = values
        .into_iter()
        .flat_map(|v| {
            let n = if v.is_finite() { (v / step).round() as i16 } else { MISSING };
            n.to_le_bytes()
        })
        .collect();
    json!({"$": "i2", "s": step, "b": base64(&bytes)})
}

/// Shape of a [`matrix`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// True to leave out what is below the diagonal.
    pub upper: bool,
    /// Bytes of each value: 4 keep it within 2⁻³² of the largest of its column, 5 within 2⁻⁴⁰.
    pub bytes: usize,
}

/// A matrix for computing: `{"r": rows, "c": columns, "u": upper, "n": bytes, "e": […], "b": …}`.
/// Every column is a list of integers times 2 to the power of its own entry of `e`. Columns follow
/// each other in `b`.
pub fn matrix(shape: Shape, value: impl Fn(usize, usize) -> f64) -> Value {
    let Shape { rows, columns, upper, bytes: width } = shape;
    let bits = 8 * width as i32 - 1;
    let (mut exponents, mut bytes) = (Vec::with_capacity(columns), Vec::new());
    for j in 0..columns {
        let column: Vec<f64> = (0..if upper { rows.min(j + 1) } else { rows }).map(|i| value(i, j)).collect();
        let largest = column.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let exponent = if largest > 0.0 { largest.log2().floor() as i32 + 1 - bits } else { 0 };
        exponents.push(exponent);
        for v in column {
            // by halves, because the power of a tiny column is beyond the largest number
            let n = (v * 2f64.powi(-exponent / 2) * 2f64.powi(-exponent - -exponent / 2)).round() as i64;
            let n = n.clamp(1 - (1 << bits), (1 << bits) - 1);
            bytes.extend(&n.to_le_bytes()[..width]);
        }
    }
    json!({"r": rows, "c": columns, "u": upper, "n": width, "e": exponents, "b": base64(&bytes)})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validate_base64_against_the_vectors_of_rfc_4648() {
        let known =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE=")];
        for (plain, coded) in known.into_iter().chain([("foobar", "Zm9vYmFy")]) {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn compressed_text_comes_back() {
        let text = "Nm ".repeat(2_000) + "µ";
        let packed = deflated(&text);
        assert!(packed.len() < 100, "{}", packed.len());
        let bytes: Vec<u8> = packed
            .trim_end_matches('=')
            .as_bytes()
            .chunks(4)
            .flat_map(|c| {
                let digit = |b: &u8| DIGITS.iter().position(|d| d == b).unwrap() as u32;
                let word = c.iter().enumerate().fold(0, |w, (i, b)| w | digit(b) << (18 - 6 * i));
                word.to_be_bytes()[1..c.len()].to_vec()
            })
            .collect();
        let mut back = String::new();
        std::io::Read::read_to_string(&mut flate2::read::DeflateDecoder::new(bytes.as_slice()), &mut back).unwrap();
        assert_eq!(back, text);
    }

    #[test]
    fn large_values_take_larger_steps() {
        let packed = steps([100.0, -327_670.0], 0.001);
        assert_eq!(packed["s"], 10.0);
        assert_eq!(packed["b"], base64(&[10, 0, 0x01, 0x80]));
    }

    #[test]
    fn missing_values_stay_missing() {
        assert_eq!(numbers(&[1.0, f64::NAN]), json!([1.0, null]));
        // 0x8000 and 2: bytes 00 80 02 00
        assert_eq!(steps([f64::NAN, 0.002], 0.001)["b"], json!(base64(&[0, 0x80, 2, 0])));
        let long = numbers(&[0.5; 30]);
        assert_eq!(long["$"], "f4");
        assert_eq!(long["b"].as_str().map(str::len), Some(160));
    }

    #[test]
    fn matrices_keep_twelve_digits_of_each_column() {
        let value = |i: usize, j: usize| [[1.0, -3e-200, 0.0], [0.0, 1e-200, 1e9 + 0.125]][i][j];
        let shape = Shape { rows: 2, columns: 3, upper: true, bytes: 5 };
        let packed = matrix(shape, value);
        assert_eq!((&packed["r"], &packed["c"]), (&json!(2), &json!(3)));
        // 1 is 2^38 times 2^-38
        assert_eq!(packed["e"][0], -38);
        let text = packed["b"].as_str().unwrap();
        assert_eq!(text.len(), 5_usize.pow(2).div_ceil(3) * 4, "one, two and two values of five bytes");
        assert!(text.starts_with(&base64(&[0, 0, 0, 0, 0x40])[..4]));
        let exponent = packed["e"][2].as_i64().unwrap() as i32;
        let n = (value(1, 2) / 2f64.powi(exponent)).round();
        assert!((n * 2f64.powi(exponent) / value(1, 2) - 1.0).abs() < 2f64.powi(-39));
        let shorter = matrix(Shape { bytes: 4, ..shape }, value);
        assert_eq!((shorter["e"][0].as_i64(), shorter["b"].as_str().unwrap().len()), (Some(-30), 28));
    }
}
