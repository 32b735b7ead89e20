//! Functions of coordinates in OpenSim models.

use roxmltree::Node;

/// A function of one coordinate.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Function {
    /// A value.
    Constant(f64),
    /// Coefficients, the highest power first.
    Polynomial(Vec<f64>),
    /// SIMM's cubic spline.
    Spline(Spline),
    /// A function times a factor.
    Scaled(Box<Function>, f64),
}

pub(crate) fn numbers(text: &str) -> Option<Vec<f64>> {
    // none: the caller names the element
    text.split_whitespace().map(|w| w.parse::<f64>().ok().filter(|x| x.is_finite())).collect()
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|c| c.has_tag_name(name))
}

impl Function {
    /// Reads a function element.
    ///
    /// # Errors
    /// What is not supported, in words.
    pub fn read(node: Node<'_, '_>) -> Result<Self, String> {
        let list = |name: &str| {
            let found = node.children().find(|c| c.has_tag_name(name));
            let text = found.and_then(|c| c.text()).unwrap_or_default();
            numbers(text).ok_or_else(|| format!("`{name}` of a {} is not a list of numbers", node.tag_name().name()))
        };
        match node.tag_name().name() {
            "Constant" => Ok(Self::Constant(list("value")?.first().copied().unwrap_or(0.0))),
            "LinearFunction" | "PolynomialFunction" => Ok(Self::Polynomial(list("coefficients")?)),
            "SimmSpline" => Spline::new(list("x")?, list("y")?).map(Self::Spline),
            "MultiplierFunction" => {
                let inner = child(node, "function").and_then(|f| f.children().find(Node::is_element));
                let inner = inner.ok_or("a MultiplierFunction without a function")?;
                Ok(Self::Scaled(Box::new(Self::read(inner)?), list("scale")?.first().copied().unwrap_or(1.0)))
            }
            other => Err(format!("the function {other}")),
        }
    }

    pub fn value(&self, x: f64) -> f64 {
        match self {
            Self::Constant(c) => *c,
            Self::Polynomial(c) => c.iter().fold(0.0, |sum, c| sum * x + c),
            Self::Spline(s) => s.value(x),
            Self::Scaled(f, by) => by * f.value(x),
        }
    }

    /// Derivative with respect to the coordinate.
    pub fn slope(&self, x: f64) -> f64 {
        match self {
            Self::Constant(_) => 0.0,
            Self::Polynomial(c) => {
                let n = c.len().saturating_sub(1);
                c.iter().take(n).enumerate().fold(0.0, |sum, (i, c)| sum * x + c * (n - i) as f64)
            }
            Self::Spline(s) => s.slope(x),
            Self::Scaled(f, by) => by * f.slope(x),
        }
    }

    /// True for the coordinate itself or its negative.
    pub fn is_one_to_one(&self) -> bool {
        matches!(self, Self::Polynomial(c) if matches!(c.as_slice(), [slope, 0.0] if slope.abs() == 1.0))
    }

    /// True for a value that no coordinate changes.
    pub fn is_constant(&self) -> bool {
        match self {
            Self::Constant(_) => true,
            Self::Polynomial(c) => c.iter().rev().skip(1).all(|c| *c == 0.0),
            Self::Spline(s) => s.y.windows(2).all(|y| y[0] == y[1]),
            Self::Scaled(f, by) => *by == 0.0 || f.is_constant(),
        }
    }

    /// True for a value that no coordinate changes and that is zero.
    pub fn is_zero(&self) -> bool {
        match self {
            Self::Constant(c) => *c == 0.0,
            Self::Polynomial(c) => c.iter().all(|c| *c == 0.0),
            Self::Spline(s) => s.y.iter().all(|y| *y == 0.0),
            Self::Scaled(f, by) => *by == 0.0 || f.is_zero(),
        }
    }
}

/// SIMM's cubic spline: interpolating, its third derivative at the ends that of the cubic through
/// the four points there (Forsythe, Malcolm and Moler 1977, *Computer Methods for Mathematical
/// Computations*, `SPLINE`); straight beyond its ends.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Spline {
    x: Vec<f64>,
    y: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
    d: Vec<f64>,
}

impl Spline {
    fn new(x: Vec<f64>, y: Vec<f64>) -> Result<Self, String> {
        let n = x.len();
        if n < 2 || y.len() != n || x.windows(2).any(|w| w[1] <= w[0]) {
            return Err(format!("a SimmSpline with {n} x and {} y that do not increase", y.len()));
        }
        if n == 2 {
            let slope = (y[1] - y[0]) / (x[1] - x[0]);
            return Ok(Self { x, y, b: vec![slope; 2], c: vec![0.0; 2], d: vec![0.0; 2] });
        }
        let (mut b, mut c, mut d) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        d[0] = x[1] - x[0];
        c[1] = (y[1] - y[0]) / d[0];
        for i in 1..n - 1 {
            d[i] = x[i + 1] - x[i];
            b[i] = 2.0 * (d[i - 1] + d[i]);
            c[i + 1] = (y[i + 1] - y[i]) / d[i];
            c[i] = c[i + 1] - c[i];
        }
        (b[0], b[n - 1]) = (-d[0], -d[n - 2]);
        (c[0], c[n - 1]) = (0.0, 0.0);
        if n > 3 {
            c[0] = c[2] / (x[3] - x[1]) - c[1] / (x[2] - x[0]);
            c[n - 1] = c[n - 2] / (x[n - 1] - x[n - 3]) - c[n - 3] / (x[n - 2] - x[n - 4]);
            c[0] = c[0] * d[0] * d[0] / (x[3] - x[0]);
            c[n - 1] = -c[n - 1] * d[n - 2] * d[n - 2] / (x[n - 1] - x[n - 4]);
        }
        for i in 1..n {
            let t = d[i - 1] / b[i - 1];
            b[i] -= t * d[i - 1];
            c[i] -= t * c[i - 1];
        }
        c[n - 1] /= b[n - 1];
        for i in (0..n - 1).rev() {
            c[i] = (c[i] - d[i] * c[i + 1]) / b[i];
        }
        b[n - 1] = (y[n - 1] - y[n - 2]) / d[n - 2] + d[n - 2] * (c[n - 2] + 2.0 * c[n - 1]);
        for i in 0..n - 1 {
            b[i] = (y[i + 1] - y[i]) / d[i] - d[i] * (c[i + 1] + 2.0 * c[i]);
            d[i] = (c[i + 1] - c[i]) / d[i];
            c[i] *= 3.0;
        }
        c[n - 1] *= 3.0;
        d[n - 1] = d[n - 2];
        Ok(Self { x, y, b, c, d })
    }

    fn value(&self, at: f64) -> f64 {
        let last = self.x.len() - 1;
        if at < self.x[0] {
            return self.y[0] + (at - self.x[0]) * self.b[0];
        }
        if at > self.x[last] {
            return self.y[last] + (at - self.x[last]) * self.b[last];
        }
        let i = self.x.partition_point(|x| *x <= at).saturating_sub(1).min(last);
        let h = at - self.x[i];
        self.y[i] + h * (self.b[i] + h * (self.c[i] + h * self.d[i]))
    }

    fn slope(&self, at: f64) -> f64 {
        let last = self.x.len() - 1;
        if at < self.x[0] {
            return self.b[0];
        }
        if at > self.x[last] {
            return self.b[last];
        }
        let i = self.x.partition_point(|x| *x <= at).saturating_sub(1).min(last);
        let h = at - self.x[i];
        self.b[i] + h * (2.0 * self.c[i] + h * 3.0 * self.d[i])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn a_spline_through_points_of_a_cubic_is_the_cubic() {
        let f = |x: f64| 0.3 * x.powi(3) - x * x + 2.0 * x - 0.5;
        let x: Vec<f64> = vec![-2.0, -1.1, 0.0, 0.7, 2.0, 2.5];
        let spline = Spline::new(x.clone(), x.iter().map(|x| f(*x)).collect()).unwrap();
        for k in 0..=45 {
            let at = -2.0 + 0.1 * f64::from(k);
            assert!((spline.value(at) - f(at)).abs() < 1e-12, "{at}");
            assert!((spline.slope(at) - (0.9 * at * at - 2.0 * at + 2.0)).abs() < 1e-11, "{at}");
        }
        // straight beyond the ends
        let slope = (spline.value(4.0) - spline.value(3.0)) / 1.0;
        assert!((slope - (0.9 * 2.5 * 2.5 - 5.0 + 2.0)).abs() < 1e-9);
    }

    #[test]
    fn functions_as_opensim_writes_them() {
        let read = |text: &str| {
            let document = roxmltree::Document::parse(text).unwrap();
            Function::read(document.root_element())
        };
        let linear = read("<LinearFunction><coefficients> -1 0.5</coefficients></LinearFunction>").unwrap();
        assert_eq!(linear.value(2.0), -1.5);
        let scaled = read(
            "<MultiplierFunction><function><Constant><value>0.2</value></Constant></function><scale>1.5</scale></MultiplierFunction>",
        );
        assert!((scaled.unwrap().value(9.0) - 0.3).abs() < 1e-15);
        assert!(read("<GCVSpline/>").unwrap_err().contains("GCVSpline"));
    }
}
