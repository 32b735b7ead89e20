//! Parses a formula; every node stores its position for error messages.

use super::unit::Unit;

/// A formula as a tree; `at` counts characters from zero.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Node {
    pub at: usize,
    pub kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    Number(f64),
    Name(String),
    Negative(Box<Node>),
    Binary(char, Box<Node>, Box<Node>),
    Call(String, Box<Node>),
}

/// A parse error with its position.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Problem {
    pub at: usize,
    pub text: String,
}

/// Most parts that a formula may have with its definitions in place.
const MOST_PARTS: usize = 20_000;
/// Most levels of parts inside each other.
const MOST_LEVELS: usize = 1200;

/// A named formula, its own definitions in place.
pub(crate) struct Definition {
    pub name: String,
    pub node: Node,
    parts: usize,
    levels: usize,
}

/// Functions of one argument.
pub(crate) const FUNCTIONS: [&str; 12] =
    ["sin", "cos", "tan", "asin", "acos", "atan", "tanh", "exp", "ln", "sqrt", "abs", "signum"];

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Sign(char),
}

struct Reader {
    tokens: Vec<(usize, Token)>,
    next: usize,
    end: usize,
}

fn problem<T>(at: usize, text: impl Into<String>) -> Result<T, Problem> {
    Err(Problem { at, text: text.into() })
}

fn tokens(text: &str) -> Result<Vec<(usize, Token)>, Problem> {
    let chars: Vec<char> = text.chars().collect();
    let mut out = Vec::new();
    let mut i = 0;
    while i < chars.len() {
        let c = chars[i];
        if c.is_whitespace() {
            i += 1;
        } else if c.is_ascii_digit() || (c == '.' && chars.get(i + 1).is_some_and(char::is_ascii_digit)) {
            let start = i;
            while i < chars.len() && (chars[i].is_ascii_digit() || chars[i] == '.') {
                i += 1;
            }
            if matches!(chars.get(i), Some('e' | 'E')) {
                let sign = usize::from(matches!(chars.get(i + 1), Some('+' | '-')));
                if chars.get(i + 1 + sign).is_some_and(char::is_ascii_digit) {
                    i += 1 + sign;
                    while i < chars.len() && chars[i].is_ascii_digit() {
                        i += 1;
                    }
                }
            }
            let word: String = chars[start..i].iter().collect();
            match word.parse() {
                Ok(x) => out.push((start, Token::Number(x))),
                // none: the error names the word
                Err(_) => return problem(start, format!("`{word}` is no number")),
            }
        } else if c.is_ascii_alphabetic() || c == '_' {
            let start = i;
            while i < chars.len() && (chars[i].is_ascii_alphanumeric() || chars[i] == '_') {
                i += 1;
            }
            out.push((start, Token::Name(chars[start..i].iter().collect())));
        } else if "+-*/^()".contains(c) {
            out.push((i, Token::Sign(c)));
            i += 1;
        } else {
            return problem(i, format!("`{c}` has no meaning in a formula"));
        }
    }
    Ok(out)
}

/// Parses a formula.
pub(crate) fn parse(text: &str) -> Result<Node, Problem> {
    // deep nesting would exhaust the stack
    if text.len() > 2000 {
        return problem(0, "the formula is longer than 2000 characters");
    }
    let mut depth = 0i32;
    for (i, c) in text.chars().enumerate() {
        depth += i32::from(c == '(') - i32::from(c == ')');
        if depth > 50 {
            return problem(i, "more than 50 brackets inside each other");
        }
    }
    let tokens = tokens(text)?;
    let mut reader = Reader { tokens, next: 0, end: text.chars().count() };
    let node = reader.sum()?;
    match reader.peek() {
        None => Ok(node),
        Some((at, Token::Sign(')'))) => problem(*at, "this bracket closes nothing"),
        Some((at, _)) => problem(*at, "an operator is missing before this"),
    }
}

impl Reader {
    fn peek(&self) -> Option<&(usize, Token)> {
        self.tokens.get(self.next)
    }
    fn sign(&mut self, wanted: &str) -> Option<(usize, char)> {
        match self.peek() {
            Some((at, Token::Sign(c))) if wanted.contains(*c) => {
                let found = (*at, *c);
                self.next += 1;
                Some(found)
            }
            _ => None,
        }
    }
    fn sum(&mut self) -> Result<Node, Problem> {
        let mut left = self.product()?;
        while let Some((at, c)) = self.sign("+-") {
            let right = self.product()?;
            left = Node { at, kind: Kind::Binary(c, Box::new(left), Box::new(right)) };
        }
        Ok(left)
    }
    fn product(&mut self) -> Result<Node, Problem> {
        let mut left = self.signed()?;
        while let Some((at, c)) = self.sign("*/") {
            let right = self.signed()?;
            left = Node { at, kind: Kind::Binary(c, Box::new(left), Box::new(right)) };
        }
        Ok(left)
    }
    fn signed(&mut self) -> Result<Node, Problem> {
        let mut minus = None;
        let mut count = 0;
        while let Some((at, c)) = self.sign("+-") {
            count += usize::from(c == '-');
            minus = Some(at);
        }
        let inner = self.power()?;
        match minus {
            Some(at) if count % 2 == 1 => Ok(Node { at, kind: Kind::Negative(Box::new(inner)) }),
            _ => Ok(inner),
        }
    }
    fn power(&mut self) -> Result<Node, Problem> {
        let base = self.atom()?;
        match self.sign("^") {
            Some((at, c)) => {
                let exponent = self.signed()?;
                Ok(Node { at, kind: Kind::Binary(c, Box::new(base), Box::new(exponent)) })
            }
            None => Ok(base),
        }
    }
    fn atom(&mut self) -> Result<Node, Problem> {
        let Some((at, token)) = self.peek().cloned() else {
            return problem(self.end, "something is missing here");
        };
        self.next += 1;
        match token {
            Token::Number(x) => Ok(Node { at, kind: Kind::Number(x) }),
            Token::Sign('(') => {
                let inner = self.sum()?;
                if self.sign(")").is_none() {
                    return problem(at, "this bracket is never closed");
                }
                Ok(inner)
            }
            Token::Sign(c) => problem(at, format!("`{c}` has nothing to its left")),
            Token::Name(name) => {
                let call = matches!(self.peek(), Some((_, Token::Sign('('))));
                if FUNCTIONS.contains(&name.as_str()) {
                    if !call {
                        return problem(at, format!("`{name}` is a function: write {name}(…)"));
                    }
                    let open = self.next;
                    self.next += 1;
                    let inner = self.sum()?;
                    if self.sign(")").is_none() {
                        return problem(self.tokens[open].0, "this bracket is never closed");
                    }
                    return Ok(Node { at, kind: Kind::Call(name, Box::new(inner)) });
                }
                if call {
                    return problem(at, format!("there is no function `{name}`; there are {}", FUNCTIONS.join(", ")));
                }
                Ok(Node { at, kind: Kind::Name(name) })
            }
        }
    }
}

impl Definition {
    /// A formula `text` with a name; it may use the definitions `before` it.
    pub fn new(name: &str, text: &str, before: &[Self]) -> Result<Self, Problem> {
        let node = parse(text)?.with(before)?;
        let [parts, levels] = node.extent(&[]);
        Ok(Self { name: name.to_owned(), node, parts, levels })
    }
}

impl Node {
    /// Unit of the formula, with the units of names from `lookup`.
    pub fn unit(&self, lookup: &dyn Fn(&str) -> Result<Unit, String>) -> Result<Unit, Problem> {
        match &self.kind {
            Kind::Number(_) => Ok(Unit::NONE),
            Kind::Name(name) => lookup(name).map_err(|text| Problem { at: self.at, text }),
            Kind::Negative(inner) => inner.unit(lookup),
            Kind::Call(name, inner) => {
                let unit = inner.unit(lookup)?;
                match name.as_str() {
                    "sqrt" => Ok(unit.raised(0.5)),
                    "abs" => Ok(unit),
                    "signum" => Ok(Unit::NONE),
                    _ if unit.is_none() => Ok(Unit::NONE),
                    _ => problem(
                        inner.at,
                        format!("`{name}` takes a number without unit, this has the unit {}", unit.describe()),
                    ),
                }
            }
            Kind::Binary(op, left, right) => {
                let (a, b) = (left.unit(lookup)?, right.unit(lookup)?);
                match op {
                    '*' => Ok(a.times(b, 1.0)),
                    '/' => Ok(a.times(b, -1.0)),
                    '^' => match (right.constant(), b.is_none()) {
                        (Some(power), true) => Ok(a.raised(power)),
                        (None, true) if a.is_none() => Ok(Unit::NONE),
                        (_, false) => problem(right.at, format!("an exponent has no unit, this has {}", b.describe())),
                        _ => problem(right.at, "what has a unit can be raised to a number only"),
                    },
                    // zero is compatible with any unit
                    _ if left.constant() == Some(0.0) => Ok(b),
                    _ if right.constant() == Some(0.0) || a.same(b) => Ok(a),
                    _ => problem(
                        self.at,
                        format!("units differ: {} on the left, {} on the right of `{op}`", a.describe(), b.describe()),
                    ),
                }
            }
        }
    }

    /// The formula with the definitions that it names in their place. What stands in place of a
    /// name has the position of the name.
    ///
    /// # Errors
    /// More than [`MOST_PARTS`] parts or [`MOST_LEVELS`] levels.
    pub fn with(&self, definitions: &[Definition]) -> Result<Self, Problem> {
        let [parts, levels] = self.extent(definitions);
        if parts > MOST_PARTS || levels > MOST_LEVELS {
            let text =
                format!("with its definitions the formula has more than {MOST_PARTS} parts or {MOST_LEVELS} levels");
            return problem(self.at, text);
        }
        Ok(self.replaced(definitions))
    }

    /// Parts and levels with the definitions in place.
    fn extent(&self, definitions: &[Definition]) -> [usize; 2] {
        match &self.kind {
            Kind::Number(_) => [1, 1],
            Kind::Name(name) => definitions.iter().find(|d| d.name == *name).map_or([1, 1], |d| [d.parts, d.levels]),
            Kind::Negative(inner) | Kind::Call(_, inner) => inner.extent(definitions).map(|n| n + 1),
            Kind::Binary(_, a, b) => {
                let ([p, l], [q, m]) = (a.extent(definitions), b.extent(definitions));
                [p + q + 1, l.max(m) + 1]
            }
        }
    }

    /// The same formula with the definitions in place of their names.
    fn replaced(&self, definitions: &[Definition]) -> Self {
        self.rebuilt(definitions, None)
    }

    /// The same formula with names replaced, every part at the position `at` if one is given.
    fn rebuilt(&self, definitions: &[Definition], at: Option<usize>) -> Self {
        let inside = |n: &Self| Box::new(n.rebuilt(definitions, at));
        let kind = match &self.kind {
            Kind::Number(x) => Kind::Number(*x),
            Kind::Name(name) => match definitions.iter().find(|d| d.name == *name) {
                Some(d) => return d.node.rebuilt(&[], Some(self.at)),
                None => Kind::Name(name.clone()),
            },
            Kind::Negative(n) => Kind::Negative(inside(n)),
            Kind::Call(name, n) => Kind::Call(name.clone(), inside(n)),
            Kind::Binary(op, a, b) => Kind::Binary(*op, inside(a), inside(b)),
        };
        Self { at: at.unwrap_or(self.at), kind }
    }

    /// Value of a subexpression without names.
    pub fn constant(&self) -> Option<f64> {
        match &self.kind {
            Kind::Number(x) => Some(*x),
            Kind::Negative(inner) => inner.constant().map(|x| -x),
            Kind::Binary(op, a, b) => {
                let (a, b) = (a.constant()?, b.constant()?);
                Some(match op {
                    '+' => a + b,
                    '-' => a - b,
                    '*' => a * b,
                    '/' => a / b,
                    _ => a.powf(b),
                })
            }
            _ => None,
        }
    }

    /// True if the formula uses a name.
    pub fn is_named(&self, wanted: &str) -> bool {
        let mut all = Vec::new();
        self.names(&mut all);
        all.iter().any(|(name, _)| name == wanted)
    }

    /// All names in the formula, each with the position of its first occurrence.
    pub fn names(&self, out: &mut Vec<(String, usize)>) {
        match &self.kind {
            Kind::Number(_) => {}
            Kind::Name(name) => {
                if !out.iter().any(|(n, _)| n == name) {
                    out.push((name.clone(), self.at));
                }
            }
            Kind::Negative(inner) | Kind::Call(_, inner) => inner.names(out),
            Kind::Binary(_, a, b) => {
                a.names(out);
                b.names(out);
            }
        }
    }

    /// The same formula with all parentheses written out.
    pub fn explicit(&self) -> String {
        match &self.kind {
            Kind::Number(x) => format!("{x:?}"),
            Kind::Name(name) => format!("{{{name}}}"),
            Kind::Negative(inner) => format!("(0.0-({}))", inner.explicit()),
            Kind::Call(name, inner) => format!("{name}({})", inner.explicit()),
            Kind::Binary(op, a, b) => format!("(({}){op}({}))", a.explicit(), b.explicit()),
        }
    }
}
