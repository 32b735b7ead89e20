//! The parameter section as a tree: groups of named, typed arrays, kept as stored so that rewriting
//! loses nothing.
//!
//! [`crate::C3dFile`] interprets the standard groups; all others, added by laboratories or
//! software, remain accessible by name and are written back unchanged.

use crate::{ByteOrder, C3dError, text::Text};

/// Content of a parameter, in file order (first dimension fastest).
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Characters; the first dimension is the length of each string.
    Text(Vec<u8>),
    /// Bytes.
    Bytes(Vec<u8>),
    /// 16-bit integers; some parameters use them as unsigned.
    Integers(Vec<i16>),
    /// 32-bit floats.
    Floats(Vec<f32>),
}

impl Values {
    /// Number of elements.
    pub fn len(&self) -> usize {
        match self {
            Self::Text(v) | Self::Bytes(v) => v.len(),
            Self::Integers(v) => v.len(),
            Self::Floats(v) => v.len(),
        }
    }
    /// True without elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// The type byte of the format: −1 text, 1 byte, 2 integer, 4 float.
    pub(crate) fn type_byte(&self) -> i8 {
        match self {
            Self::Text(_) => -1,
            Self::Bytes(_) => 1,
            Self::Integers(_) => 2,
            Self::Floats(_) => 4,
        }
    }
}

/// A named array.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: Text,
    /// Description.
    pub description: Text,
    /// Whether the file marks it as locked.
    pub locked: bool,
    /// Dimensions, first fastest; empty for a scalar.
    pub dimensions: Vec<u8>,
    /// The elements.
    pub values: Values,
}

impl Parameter {
    /// A new parameter. It is checked against its dimensions when written.
    pub fn new(name: &str, dimensions: Vec<u8>, values: Values) -> Self {
        Self { name: name.into(), description: Text::default(), locked: false, dimensions, values }
    }
    /// A scalar integer.
    pub fn integer(name: &str, value: i16) -> Self {
        Self::new(name, Vec::new(), Values::Integers(vec![value]))
    }
    /// A scalar float.
    pub fn float(name: &str, value: f32) -> Self {
        Self::new(name, Vec::new(), Values::Floats(vec![value]))
    }
    /// A vector of integers. With more than 255, writing fails with an error.
    pub fn integers(name: &str, values: Vec<i16>) -> Self {
        Self::new(name, vec![clamp_u8(values.len())], Values::Integers(values))
    }
    /// A vector of floats. With more than 255, writing fails with an error.
    pub fn floats(name: &str, values: Vec<f32>) -> Self {
        Self::new(name, vec![clamp_u8(values.len())], Values::Floats(values))
    }
    /// One string, at most 255 bytes.
    pub fn text(name: &str, text: &str) -> Self {
        Self::new(name, vec![clamp_u8(text.len())], Values::Text(text.as_bytes().to_vec()))
    }
    /// A list of strings, padded with blanks to the longest; at most 255 strings of 255 bytes.
    pub fn texts<S: AsRef<str>>(name: &str, texts: &[S]) -> Self {
        let length = texts.iter().map(|t| t.as_ref().len()).max().unwrap_or(0);
        let mut bytes = Vec::with_capacity(length * texts.len());
        for text in texts {
            bytes.extend_from_slice(text.as_ref().as_bytes());
            bytes.resize(bytes.len() + length - text.as_ref().len(), b' ');
        }
        Self::new(name, vec![clamp_u8(length), clamp_u8(texts.len())], Values::Text(bytes))
    }
    /// Adds a description.
    pub fn described(mut self, description: &str) -> Self {
        self.description = description.into();
        self
    }
    /// Number of elements according to the dimensions.
    pub fn announced(&self) -> usize {
        product(&self.dimensions)
    }
    /// The elements as numbers; integers signed, bytes unsigned. Empty for text.
    pub fn numbers(&self) -> Vec<f64> {
        match &self.values {
            Values::Text(_) => Vec::new(),
            Values::Bytes(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Values::Integers(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Values::Floats(v) => v.iter().map(|&x| f64::from(x)).collect(),
        }
    }
    /// First element as a number; integers signed.
    pub fn number(&self) -> Option<f64> {
        match &self.values {
            Values::Text(_) => None,
            Values::Bytes(v) => v.first().map(|&x| f64::from(x)),
            Values::Integers(v) => v.first().map(|&x| f64::from(x)),
            Values::Floats(v) => v.first().map(|&x| f64::from(x)),
        }
    }
    /// First element as a count: integers unsigned, floats only if integral and in 0..2³².
    pub fn count(&self) -> Option<usize> {
        self.counts().first().copied().flatten()
    }
    /// All elements as counts, as in [`Parameter::count`].
    pub fn counts(&self) -> Vec<Option<usize>> {
        match &self.values {
            Values::Text(_) => Vec::new(),
            Values::Bytes(v) => v.iter().map(|&x| Some(usize::from(x))).collect(),
            Values::Integers(v) => v.iter().map(|&x| Some(usize::from(x as u16))).collect(),
            Values::Floats(v) => v
                .iter()
                .map(|&x| ((0.0..4_294_967_296.0).contains(&x) && x.fract() == 0.0).then_some(x as usize))
                .collect(),
        }
    }
    /// The strings, without surrounding blanks. Empty for numbers.
    pub fn strings(&self) -> Vec<String> {
        self.raw_strings().map(crate::text::decode).collect()
    }
    /// The first string, without surrounding blanks.
    pub fn string(&self) -> Option<String> {
        self.raw_strings().next().map(crate::text::decode)
    }
    /// The strings as stored.
    pub fn raw_strings(&self) -> impl Iterator<Item = &[u8]> {
        let bytes: &[u8] = match &self.values {
            Values::Text(v) => v,
            _ => &[],
        };
        let length = self.dimensions.first().map_or(1, |&d| usize::from(d));
        // Zero-length strings also count: their number is given by the dimensions alone.
        let empties = if length == 0 && matches!(self.values, Values::Text(_)) {
            self.dimensions.get(1..).map_or(0, product).min(255)
        } else {
            0
        };
        bytes.chunks(length.max(1)).chain(std::iter::repeat_n(&[] as &[u8], empties))
    }
}

/// Number of elements of an array with these dimensions, saturating.
pub(crate) fn product(dimensions: &[u8]) -> usize {
    dimensions.iter().fold(1_usize, |n, &d| n.saturating_mul(usize::from(d)))
}

fn clamp_u8(n: usize) -> u8 {
    u8::try_from(n).unwrap_or(u8::MAX)
}

/// A group of parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Group {
    /// Number of the group in the file, 1 to 127.
    pub id: u8,
    /// Name.
    pub name: Text,
    /// Description.
    pub description: Text,
    /// Whether the file marks it as locked.
    pub locked: bool,
    /// The parameters in the order of the file.
    pub parameters: Vec<Parameter>,
}

impl Group {
    /// A parameter by name, ignoring case.
    pub fn get(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|p| p.name.is(name))
    }
    /// Replaces the parameter of the same name (keeping its description and lock if the new one has
    /// none), or appends it.
    pub fn set(&mut self, mut parameter: Parameter) {
        let name = parameter.name.decode();
        match self.parameters.iter_mut().find(|p| p.name.is(&name)) {
            Some(old) => {
                if parameter.description.0.is_empty() {
                    parameter.description = std::mem::take(&mut old.description);
                }
                parameter.locked |= old.locked;
                *old = parameter;
            }
            None => self.parameters.push(parameter),
        }
    }
    /// Removes a parameter.
    pub fn remove(&mut self, name: &str) -> Option<Parameter> {
        let index = self.parameters.iter().position(|p| p.name.is(name))?;
        Some(self.parameters.remove(index))
    }
}

/// All groups of a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    /// The groups in the order of the file.
    pub groups: Vec<Group>,
}

impl Parameters {
    /// A group by name, ignoring case.
    pub fn group(&self, name: &str) -> Option<&Group> {
        self.groups.iter().find(|g| g.name.is(name))
    }
    /// A parameter by group and name, ignoring case: `get("POINT", "RATE")`.
    pub fn get(&self, group: &str, name: &str) -> Option<&Parameter> {
        self.groups.iter().filter(|g| g.name.is(group)).find_map(|g| g.get(name))
    }
    /// Puts a parameter into a group, which is created with the lowest free number if it does not
    /// exist.
    pub fn set(&mut self, group: &str, parameter: Parameter) {
        self.group_mut(group).set(parameter);
    }
    /// A mutable group, created with the lowest free number if it does not exist.
    pub fn group_mut(&mut self, name: &str) -> &mut Group {
        let index = match self.groups.iter().position(|g| g.name.is(name)) {
            Some(index) => index,
            None => {
                let id = (1..=127).find(|id| self.groups.iter().all(|g| g.id != *id)).unwrap_or(u8::MAX);
                self.groups.push(Group { id, name: name.into(), ..Group::default() });
                self.groups.len() - 1
            }
        };
        &mut self.groups[index]
    }
    /// Removes a parameter.
    pub fn remove(&mut self, group: &str, name: &str) -> Option<Parameter> {
        self.groups.iter_mut().filter(|g| g.name.is(group)).find_map(|g| g.remove(name))
    }
    /// The strings of `NAME`, `NAME2`, `NAME3` … concatenated: the format's way to store more than
    /// 255 entries.
    pub fn merged_strings(&self, group: &str, name: &str) -> Vec<String> {
        let mut all = Vec::new();
        self.for_each_part(group, name, |part| all.extend(part.raw_strings().map(crate::text::decode)));
        all
    }
    /// The numbers of `NAME`, `NAME2`, `NAME3` … concatenated; integers signed.
    pub fn merged_numbers(&self, group: &str, name: &str) -> Vec<f64> {
        let mut all = Vec::new();
        self.for_each_part(group, name, |part| all.extend(part.numbers()));
        all
    }
    fn for_each_part(&self, group: &str, name: &str, mut take: impl FnMut(&Parameter)) {
        let Some(first) = self.get(group, name) else { return };
        take(first);
        for k in 2..=300 {
            match self.get(group, &format!("{name}{k}")) {
                Some(part) => take(part),
                None => break,
            }
        }
    }

    /// The section's bytes, including the header of four bytes, padded to whole blocks of 512.
    pub(crate) fn to_bytes(&self, order: ByteOrder) -> Result<Vec<u8>, C3dError> {
        let mut out = vec![1, 0x50, 0, order.processor()];
        let mut last_link = None;
        for (i, group) in self.groups.iter().enumerate() {
            let fail = |problem: String| C3dError::Write { item: format!("group {}", group.name), problem };
            if group.id == 0 || group.id > 127 {
                return Err(fail(format!("number {} is not in 1 to 127", group.id)));
            }
            if self.groups[..i].iter().any(|other| other.id == group.id) {
                return Err(fail(format!("number {} is taken by another group", group.id)));
            }
            let link =
                open_record(&mut out, &group.name, group.locked, (group.id as i8).wrapping_neg()).map_err(&fail)?;
            push_short(&mut out, &group.description.0).map_err(&fail)?;
            close_record(&mut out, link, order).map_err(&fail)?;
            last_link = Some(link);
            for parameter in &group.parameters {
                let fail = |problem: String| C3dError::Write {
                    item: format!("parameter {}:{}", group.name, parameter.name),
                    problem,
                };
                let link = open_record(&mut out, &parameter.name, parameter.locked, group.id as i8).map_err(&fail)?;
                push_parameter(&mut out, parameter, order).map_err(&fail)?;
                close_record(&mut out, link, order).map_err(&fail)?;
                last_link = Some(link);
            }
        }
        // The link of the last record is zero.
        if let Some(link) = last_link {
            out[link] = 0;
            out[link + 1] = 0;
        }
        out.resize(out.len().div_ceil(512) * 512, 0);
        let blocks = out.len() / 512;
        out[2] = u8::try_from(blocks).map_err(|_| C3dError::Write {
            item: "parameter section".into(),
            problem: format!("{blocks} blocks of 512 bytes, the format holds 255"),
        })?;
        Ok(out)
    }
}

/// Writes length, number and name; returns the position of the link to the next record.
fn open_record(out: &mut Vec<u8>, name: &Text, locked: bool, id: i8) -> Result<usize, String> {
    let length = i8::try_from(name.0.len()).ok().filter(|n| *n > 0).ok_or("a name has 1 to 127 bytes")?;
    out.push((if locked { -length } else { length }) as u8);
    out.push(id as u8);
    out.extend_from_slice(&name.0);
    out.extend_from_slice(&[0, 0]);
    Ok(out.len() - 2)
}

fn close_record(out: &mut [u8], link: usize, order: ByteOrder) -> Result<(), String> {
    let distance = u16::try_from(out.len() - link).map_err(|_| "more than 65,535 bytes")?;
    out[link..link + 2].copy_from_slice(&order.u16_bytes(distance));
    Ok(())
}

fn push_short(out: &mut Vec<u8>, text: &[u8]) -> Result<(), String> {
    out.push(u8::try_from(text.len()).map_err(|_| "a description of more than 255 bytes")?);
    out.extend_from_slice(text);
    Ok(())
}

fn push_parameter(out: &mut Vec<u8>, parameter: &Parameter, order: ByteOrder) -> Result<(), String> {
    let (announced, held) = (parameter.announced(), parameter.values.len());
    if announced != held {
        return Err(format!("dimensions {:?} announce {announced} elements, {held} are there", parameter.dimensions));
    }
    out.push(parameter.values.type_byte() as u8);
    out.push(u8::try_from(parameter.dimensions.len()).ok().filter(|n| *n <= 7).ok_or("more than 7 dimensions")?);
    out.extend_from_slice(&parameter.dimensions);
    match &parameter.values {
        Values::Text(v) | Values::Bytes(v) => out.extend_from_slice(v),
        Values::Integers(v) => v.iter().for_each(|&x| out.extend_from_slice(&order.u16_bytes(x as u16))),
        Values::Floats(v) => v.iter().for_each(|&x| out.extend_from_slice(&order.f32_bytes(x))),
    }
    push_short(out, &parameter.description.0)
}
