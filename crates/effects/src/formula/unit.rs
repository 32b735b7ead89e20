//! Units as exponents of metre, kilogram and second; radians have none.

/// Exponents of m, kg, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unit(pub [f64; 3]);

impl Unit {
    pub const NONE: Self = Self([0.0; 3]);
    pub const SECOND: Self = Self([0.0, 0.0, 1.0]);
    pub const FORCE: Self = Self([1.0, 1.0, -2.0]);
    pub const MOMENT: Self = Self([2.0, 1.0, -2.0]);

    pub fn times(self, other: Self, power: f64) -> Self {
        Self([0, 1, 2].map(|i| self.0[i] + power * other.0[i]))
    }
    pub fn raised(self, power: f64) -> Self {
        Self(self.0.map(|x| x * power))
    }
    pub fn same(self, other: Self) -> bool {
        self.0.iter().zip(&other.0).all(|(a, b)| (a - b).abs() < 1e-9)
    }
    pub fn is_none(self) -> bool {
        self.same(Self::NONE)
    }

    /// In words: `m·kg/s²` as `m kg s^-2`; `1` for none.
    pub fn describe(self) -> String {
        let parts: Vec<String> = ["m", "kg", "s"]
            .iter()
            .zip(self.0)
            .filter(|(_, p)| p.abs() > 1e-9)
            .map(|(n, p)| if (p - 1.0).abs() < 1e-9 { (*n).to_owned() } else { format!("{n}^{p}") })
            .collect();
        if parts.is_empty() { "1".to_owned() } else { parts.join(" ") }
    }

    /// Parses `N*s/m`, `kg m^2`, `N·m·s/rad`, `m/s²`, `1`: factors separated by `*`, `·` or a
    /// space; a factor after `/` is in the denominator.
    ///
    /// The error is the part that cannot be parsed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut out = Self::NONE;
        let spaced = text.replace('²', "^2").replace('³', "^3").replace('/', " / ");
        let mut below = false;
        for word in spaced.split(|c: char| c.is_whitespace() || c == '*' || c == '·').filter(|w| !w.is_empty()) {
            if word == "/" {
                below = true;
                continue;
            }
            let (name, power) = match word.split_once('^') {
                Some((name, power)) => (name, power.parse::<f64>().map_err(|_| word.to_owned())?),
                None => (word, 1.0),
            };
            let unit = match name {
                "1" | "rad" => Self::NONE,
                "m" => Self([1.0, 0.0, 0.0]),
                "kg" => Self([0.0, 1.0, 0.0]),
                "s" => Self::SECOND,
                "N" => Self::FORCE,
                "J" => Self::MOMENT,
                "W" => Self([2.0, 1.0, -3.0]),
                "Pa" => Self([-1.0, 1.0, -2.0]),
                "Hz" => Self([0.0, 0.0, -1.0]),
                _ => return Err(name.to_owned()),
            };
            out = out.times(unit, if below { -power } else { power });
            // only the factor directly after a `/` is in the denominator, as in common usage of
            // `N*s/m`; `kg/m*s` is read from left to right
            below = false;
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_people_write() {
        assert!(Unit::parse("N*s/m").unwrap().same(Unit([0.0, 1.0, -1.0])));
        assert!(Unit::parse("kg·m²").unwrap().same(Unit([2.0, 1.0, 0.0])));
        assert!(Unit::parse("N·m·s/rad").unwrap().same(Unit([2.0, 1.0, -1.0])));
        assert!(Unit::parse("1").unwrap().is_none());
        assert!(Unit::parse("m/s/s").unwrap().same(Unit([1.0, 0.0, -2.0])));
        assert_eq!(Unit::parse("lbf"), Err("lbf".to_owned()));
    }
}
