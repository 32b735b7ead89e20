//! Formulas of hidden laws: numbers, names, functions, operators. Parsed once to postfix order.
//!
//! The parser is small and the simulator's own. The one of the effects belongs to the estimator, of
//! which the simulator is independent; and general expression crates lack what is needed here:
//! `exmex` reads `-x^2` as `(-x)^2`, knows neither `1e-3` nor functions of three arguments, and
//! gives no position of an error.

/// Deepest nesting of a formula.
const DEPTH: usize = 60;

/// A parsed formula over quantities of type `Q`.
#[derive(Debug, Clone, PartialEq)]
pub struct Formula<Q> {
    steps: Vec<Step<Q>>,
}

/// An error in a formula: the character (from 0) and what is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Position in the text, characters from 0.
    pub at: usize,
    /// What is wrong.
    pub text: String,
}

#[derive(Debug, Clone, PartialEq)]
enum Step<Q> {
    Number(f64),
    Quantity(Q),
    Negate,
    Operator(char),
    Function(usize),
}

#[derive(Clone, Copy)]
enum Call {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
    /// Distance from a place in the world.
    Distance,
}

/// All functions.
const FUNCTIONS: [(&str, Call); 16] = [
    ("abs", Call::One(f64::abs)),
    ("sign", Call::One(sign)),
    ("step", Call::One(step)),
    ("sqrt", Call::One(f64::sqrt)),
    ("exp", Call::One(f64::exp)),
    ("ln", Call::One(f64::ln)),
    ("sin", Call::One(f64::sin)),
    ("cos", Call::One(f64::cos)),
    ("tan", Call::One(f64::tan)),
    ("atan", Call::One(f64::atan)),
    ("tanh", Call::One(f64::tanh)),
    ("min", Call::Two(f64::min)),
    ("max", Call::Two(f64::max)),
    ("hypot", Call::Two(f64::hypot)),
    ("atan2", Call::Two(f64::atan2)),
    ("dist", Call::Distance),
];

fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

fn step(x: f64) -> f64 {
    if x >= 0.0 { 1.0 } else { 0.0 }
}

impl Call {
    fn arguments(self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Two(_) => 2,
            Self::Distance => 3,
        }
    }
}

impl<Q: Copy> Formula<Q> {
    /// Parses `text`; `lookup` knows the names of the quantities, `known` lists them for the
    /// message about an unknown one.
    ///
    /// # Errors
    /// [`Problem`] with the position of what is not understood.
    pub fn parse(text: &str, lookup: &dyn Fn(&str) -> Option<Q>, known: &str) -> Result<Self, Problem> {
        let mut reader = Reader {
            tokens: tokens(text)?,
            next: 0,
            end: text.chars().count(),
            steps: Vec::new(),
            depth: 0,
            lookup,
            known,
        };
        reader.sum()?;
        match reader.tokens.get(reader.next) {
            None => Ok(Self { steps: reader.steps }),
            Some((at, Token::Sign(')'))) => problem(*at, "this bracket closes nothing"),
            Some((at, Token::Sign(','))) => problem(*at, "a comma outside of a function"),
            Some((at, _)) => problem(*at, "an operator is missing before this"),
        }
    }

    /// Value with the quantities given by `of`; `place` is the point from which `dist` is measured.
    /// NaN or infinite where the formula is not defined. `stack` is workspace.
    pub fn value(&self, stack: &mut Vec<f64>, place: &[f64; 3], of: impl Fn(Q) -> f64) -> f64 {
        stack.clear();
        for step in &self.steps {
            let value = match step {
                Step::Number(x) => *x,
                Step::Quantity(q) => of(*q),
                Step::Negate => -pop(stack),
                Step::Operator(sign) => {
                    let (b, a) = (pop(stack), pop(stack));
                    match sign {
                        '+' => a + b,
                        '-' => a - b,
                        '*' => a * b,
                        '/' => a / b,
                        _ => a.powf(b),
                    }
                }
                Step::Function(k) => match FUNCTIONS[*k].1 {
                    Call::One(f) => f(pop(stack)),
                    Call::Two(f) => {
                        let (b, a) = (pop(stack), pop(stack));
                        f(a, b)
                    }
                    Call::Distance => {
                        let (z, y, x) = (pop(stack), pop(stack), pop(stack));
                        ((place[0] - x).powi(2) + (place[1] - y).powi(2) + (place[2] - z).powi(2)).sqrt()
                    }
                },
            };
            stack.push(value);
        }
        pop(stack)
    }
}

/// The parser leaves as many values on the stack as are taken.
fn pop(stack: &mut Vec<f64>) -> f64 {
    stack.pop().unwrap_or(f64::NAN)
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Sign(char),
}

struct Reader<'a, Q> {
    tokens: Vec<(usize, Token)>,
    next: usize,
    end: usize,
    steps: Vec<Step<Q>>,
    depth: usize,
    lookup: &'a dyn Fn(&str) -> Option<Q>,
    known: &'a str,
}

fn problem<T>(at: usize, text: impl Into<String>) -> Result<T, Problem> {
    Err(Problem { at, text: text.into() })
}

fn tokens(text: &str) -> Result<Vec<(usize, Token)>, Problem> {
    let chars: Vec<char> = text.chars().collect();
    let digit = |i: usize| chars.get(i).is_some_and(char::is_ascii_digit);
    let mut out = Vec::new();
    let mut i = 0;
    while i < chars.len() {
        let (c, start) = (chars[i], i);
        if c.is_whitespace() {
            i += 1;
        } else if c.is_ascii_digit() || (c == '.' && digit(i + 1)) {
            while digit(i) || chars.get(i) == Some(&'.') {
                i += 1;
            }
            if matches!(chars.get(i), Some('e' | 'E')) {
                let signed = usize::from(matches!(chars.get(i + 1), Some('+' | '-')));
                if digit(i + 1 + signed) {
                    i += 1 + signed;
                    while digit(i) {
                        i += 1;
                    }
                }
            }
            let word: String = chars[start..i].iter().collect();
            match word.parse() {
                Ok(x) => out.push((start, Token::Number(x))),
                // none: the error names the word
                Err(_) => return problem(start, format!("`{word}` is not a number")),
            }
        } else if c.is_alphabetic() || c == '_' {
            while chars.get(i).is_some_and(|c| c.is_alphanumeric() || *c == '_') {
                i += 1;
            }
            out.push((start, Token::Name(chars[start..i].iter().collect())));
        } else if "+-*/^(),".contains(c) {
            out.push((i, Token::Sign(c)));
            i += 1;
        } else {
            return problem(i, format!("`{c}` has no meaning in a formula"));
        }
    }
    Ok(out)
}

impl<Q: Copy> Reader<'_, Q> {
    fn sign(&mut self, wanted: &str) -> Option<char> {
        match self.tokens.get(self.next) {
            Some((_, Token::Sign(c))) if wanted.contains(*c) => {
                self.next += 1;
                Some(*c)
            }
            _ => None,
        }
    }

    fn at(&self) -> usize {
        self.tokens.get(self.next).map_or(self.end, |t| t.0)
    }

    fn sum(&mut self) -> Result<(), Problem> {
        self.depth += 1;
        if self.depth > DEPTH {
            return problem(self.at(), format!("more than {DEPTH} brackets inside each other"));
        }
        self.product()?;
        while let Some(c) = self.sign("+-") {
            self.product()?;
            self.steps.push(Step::Operator(c));
        }
        self.depth -= 1;
        Ok(())
    }

    fn product(&mut self) -> Result<(), Problem> {
        self.signed()?;
        while let Some(c) = self.sign("*/") {
            self.signed()?;
            self.steps.push(Step::Operator(c));
        }
        Ok(())
    }

    /// Signs bind less than a power: `-x^2` is `-(x^2)`.
    fn signed(&mut self) -> Result<(), Problem> {
        let mut negative = false;
        while let Some(c) = self.sign("+-") {
            negative ^= c == '-';
        }
        self.power()?;
        if negative {
            self.steps.push(Step::Negate);
        }
        Ok(())
    }

    /// Powers are read from the right: `a^b^c` is `a^(b^c)`.
    fn power(&mut self) -> Result<(), Problem> {
        self.operand()?;
        if self.sign("^").is_some() {
            self.depth += 1;
            if self.depth > DEPTH {
                return problem(self.at(), format!("more than {DEPTH} powers and brackets inside each other"));
            }
            self.signed()?;
            self.depth -= 1;
            self.steps.push(Step::Operator('^'));
        }
        Ok(())
    }

    fn operand(&mut self) -> Result<(), Problem> {
        let at = self.at();
        match self.tokens.get(self.next).map(|t| t.1.clone()) {
            Some(Token::Number(x)) => {
                self.next += 1;
                self.steps.push(Step::Number(x));
                Ok(())
            }
            Some(Token::Name(name)) => {
                self.next += 1;
                self.name(at, &name)
            }
            Some(Token::Sign('(')) => {
                self.next += 1;
                self.sum()?;
                self.close(at)
            }
            Some(Token::Sign(c)) => problem(at, format!("a number, a name or a bracket is missing before `{c}`")),
            None => problem(at, "the formula ends where a number or a name is expected"),
        }
    }

    fn close(&mut self, opened: usize) -> Result<(), Problem> {
        match self.sign(")") {
            Some(_) => Ok(()),
            None if self.next == self.tokens.len() => problem(opened, "the bracket opened here is not closed"),
            None => problem(self.at(), "an operator or a closing bracket is missing before this"),
        }
    }

    fn name(&mut self, at: usize, name: &str) -> Result<(), Problem> {
        let function = FUNCTIONS.iter().position(|f| f.0 == name);
        let bracket = self.sign("(").is_some();
        match (function, bracket) {
            (Some(k), true) => {
                let wanted = FUNCTIONS[k].1.arguments();
                let mut found = 1;
                self.sum()?;
                while self.sign(",").is_some() {
                    self.sum()?;
                    found += 1;
                }
                self.close(at)?;
                if found != wanted {
                    return problem(at, format!("`{name}` takes {wanted} arguments, found {found}"));
                }
                self.steps.push(Step::Function(k));
                Ok(())
            }
            (Some(_), false) => problem(at, format!("the function `{name}` needs its arguments in brackets")),
            (None, true) => {
                let functions: Vec<&str> = FUNCTIONS.iter().map(|f| f.0).collect();
                problem(at, format!("there is no function `{name}`; there are {}", functions.join(" ")))
            }
            (None, false) if name == "pi" => {
                self.steps.push(Step::Number(std::f64::consts::PI));
                Ok(())
            }
            (None, false) => match (self.lookup)(name) {
                Some(q) => {
                    self.steps.push(Step::Quantity(q));
                    Ok(())
                }
                None => problem(at, format!("nothing is called `{name}`; there are {} pi", self.known)),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        let lookup = |name: &str| ["x", "y"].iter().position(|n| *n == name);
        let formula = Formula::parse(text, &lookup, "x y").expect(text);
        formula.value(&mut Vec::new(), &[1.0, 2.0, 3.0], |q| [3.0, -0.5][q])
    }
    fn fault(text: &str) -> (usize, String) {
        let lookup = |name: &str| ["x", "y"].iter().position(|n| *n == name);
        let p = Formula::parse(text, &lookup, "x y").expect_err(text);
        (p.at, p.text)
    }

    #[test]
    fn operators_bind_as_in_writing() {
        for (text, want) in [
            ("-x^2", -9.0),
            ("2*-x^2", -18.0),
            ("x^-1", 1.0 / 3.0),
            ("2^3^2", 512.0),
            ("1 - 2 - 3", -4.0),
            ("12/2/3", 2.0),
            ("1e-3*x + .5E1", 5.003),
            ("-(x + y)*2", -5.0),
            ("--x", 3.0),
            ("min(x, y)*max(1, -y)", -0.5),
            ("sign(y) + sign(0) + step(0) + step(-1e-9)", 0.0),
            ("dist(1, 2, 0.5 + y)", 3.0),
            ("cos(pi)", -1.0),
            ("hypot(x, 4) + atan2(0, 1)", 5.0),
            ("abs(y)^1.5", 0.5f64.powf(1.5)),
        ] {
            let got = value(text);
            assert!((got - want).abs() < 1e-15 * want.abs().max(1.0), "{text}: {got} {want}");
        }
    }

    #[test]
    fn faults_are_located() {
        for (text, at, part) in [
            ("x + vq", 4, "nothing is called `vq`"),
            ("2 x", 2, "an operator is missing"),
            ("x)", 1, "closes nothing"),
            ("(x + 1", 0, "not closed"),
            ("sin x", 0, "in brackets"),
            ("sine(x)", 0, "no function `sine`"),
            ("min(x)", 0, "takes 2 arguments, found 1"),
            ("dist(1, 2)", 0, "takes 3 arguments, found 2"),
            ("x, y", 1, "a comma outside"),
            ("x + ", 4, "ends where"),
            ("", 0, "ends where"),
            ("x $ y", 2, "`$` has no meaning"),
            ("1.2.3", 0, "not a number"),
            ("x * / y", 4, "missing before `/`"),
            ("(x y)", 3, "missing before this"),
        ] {
            let (found, message) = fault(text);
            assert_eq!(found, at, "{text}: {message}");
            assert!(message.contains(part), "{text}: {message}");
        }
        assert!(fault(&"(".repeat(500)).1.contains("inside each other"));
        assert!(fault(&"x^".repeat(500)).1.contains("inside each other"));
    }
}
