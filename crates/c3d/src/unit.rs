//! Units in the spellings found in files.

/// Metres in a length unit, by its usual spellings in any case, with or without a full stop (`mm`,
/// `Meters`, `in.`); `None` for an unknown unit. Every reader of recordings uses this list.
pub fn metres_per(unit: &str) -> Option<f64> {
    match unit.trim().trim_end_matches('.').to_ascii_lowercase().as_str() {
        "m" | "meter" | "meters" | "metre" | "metres" => Some(1.0),
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(1e-3),
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => Some(1e-2),
        "dm" => Some(1e-1),
        "in" | "inch" | "inches" => Some(0.0254),
        "ft" | "feet" | "foot" => Some(0.3048),
        _ => None,
    }
}

/// Newtons in a force unit.
pub(crate) fn newtons(unit: &str) -> Option<f64> {
    match unit.trim().to_ascii_lowercase().as_str() {
        "n" | "nt" | "newton" | "newtons" => Some(1.0),
        "kn" => Some(1e3),
        "lb" | "lbf" | "lbs" => Some(4.448_221_615_260_5),
        "kgf" | "kg" | "kp" => Some(9.806_65),
        _ => None,
    }
}

/// Newton metres in a moment unit: `Nmm`, `N.m`, `N*mm`, `N-m`, `Newton-mm` …
pub(crate) fn newton_metres(unit: &str) -> Option<f64> {
    let plain: String = unit.chars().filter(|c| c.is_ascii_alphabetic()).collect::<String>().to_ascii_lowercase();
    for force in ["newtons", "newton", "nt", "kn", "n", "lbf", "lbs", "lb"] {
        if let Some(length) = plain.strip_prefix(force)
            && let (Some(f), Some(l)) = (newtons(force), metres_per(length))
        {
            return Some(f * l);
        }
    }
    // Pound-force inches are also written in reverse order.
    match plain.as_str() {
        "inlb" | "inlbs" | "inlbf" => Some(4.448_221_615_260_5 * 0.0254),
        "ftlb" | "ftlbs" | "ftlbf" => Some(4.448_221_615_260_5 * 0.3048),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_spellings() {
        for (unit, metres) in
            [(" mm", 1e-3), ("MM.", 1e-3), ("dm", 1e-1), ("Metres", 1.0), ("in.", 0.0254), ("feet", 0.3048)]
        {
            assert_eq!(metres_per(unit), Some(metres), "{unit}");
        }
        assert_eq!((metres_per(""), metres_per("deg")), (None, None));
        assert_eq!(newton_metres("Nmm"), Some(1e-3));
        assert_eq!(newton_metres("N.mm"), Some(1e-3));
        assert_eq!(newton_metres("N*m"), Some(1.0));
        assert_eq!(newton_metres("N-m"), Some(1.0));
        assert_eq!(newton_metres("Newton-meters"), Some(1.0));
        assert_eq!(newton_metres("V"), None);
        assert_eq!(newton_metres("N"), None);
    }
}
