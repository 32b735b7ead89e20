//! Reads the parameter section. Every length is checked against the file before it is used.

use crate::{
    ByteOrder, C3dError, Group, Parameter, Parameters, Values, Warning, WarningKind, parameters::product, text::Text,
};

/// Reads the records from `start` (just after the section's four bytes) to at most `end`.
pub(crate) fn read_parameters(
    bytes: &[u8],
    start: usize,
    end: usize,
    order: ByteOrder,
    warnings: &mut Vec<Warning>,
) -> Result<Parameters, C3dError> {
    let end = end.min(bytes.len());
    let mut tree = Parameters::default();
    let mut at = start;
    while at + 2 <= end {
        let name_length = bytes[at] as i8;
        let id = bytes[at + 1] as i8;
        if name_length == 0 || id == 0 {
            break;
        }
        let locked = name_length < 0;
        let name_length = usize::from(name_length.unsigned_abs());
        let link = at + 2 + name_length;
        let name = Text(bytes.get(at + 2..link).unwrap_or_default().to_vec());
        let fail = |problem: String| C3dError::Parameter {
            offset: at,
            group: if id < 0 { name.decode() } else { group_name(&tree, id.unsigned_abs()) },
            parameter: if id < 0 { String::new() } else { name.decode() },
            problem,
        };
        if link + 2 > end {
            return Err(fail(format!("the name ends at byte {}, the section at byte {end}", link + 2)));
        }
        let distance = usize::from(order.u16([bytes[link], bytes[link + 1]]));
        // A distance of 0 marks the last record; one beyond the section is treated the same way.
        let last = distance == 0 || link + distance >= end;
        let next = if last { end } else { link + distance };
        if next < link + 3 {
            return Err(fail(format!("the next record is said to start {distance} bytes on, inside this one")));
        }
        let body = &bytes[link + 2..next];
        if id < 0 {
            let description = counted(body);
            take_group(&mut tree, id.unsigned_abs(), name, description, locked, at, warnings);
        } else {
            match parse_body(body, order) {
                Ok((dimensions, values, description)) => {
                    let parameter = Parameter { name, description, locked, dimensions, values };
                    group_by_id(&mut tree, id.unsigned_abs()).parameters.push(parameter);
                }
                Err(problem) if next >= bytes.len() => return Err(fail(problem)),
                Err(problem) => {
                    warnings.push(Warning::new(WarningKind::Parameters, format!("{}; skipped", fail(problem))))
                }
            }
        }
        if last {
            break;
        }
        at = next;
    }
    for group in &mut tree.groups {
        if group.name.0.is_empty() {
            group.name = Text::from(format!("GROUP{}", group.id).as_str());
            let message = format!("parameters of group number {}, which has no record of its own", group.id);
            warnings.push(Warning::new(WarningKind::Parameters, message));
        }
    }
    Ok(tree)
}

fn group_by_id(tree: &mut Parameters, id: u8) -> &mut Group {
    let index = match tree.groups.iter().position(|g| g.id == id) {
        Some(index) => index,
        None => {
            tree.groups.push(Group { id, ..Group::default() });
            tree.groups.len() - 1
        }
    };
    &mut tree.groups[index]
}

fn group_name(tree: &Parameters, id: u8) -> String {
    let named = tree.groups.iter().find(|g| g.id == id && !g.name.0.is_empty());
    named.map_or_else(|| format!("group {id}"), |g| g.name.decode())
}

fn take_group(
    tree: &mut Parameters,
    id: u8,
    name: Text,
    description: Text,
    locked: bool,
    at: usize,
    warnings: &mut Vec<Warning>,
) {
    let group = group_by_id(tree, id);
    if group.name.0.is_empty() {
        group.name = name;
        group.description = description;
        group.locked = locked;
    } else {
        let message =
            format!("byte {at}: group {name} has the number {id} of group {}; its parameters are there", group.name);
        warnings.push(Warning::new(WarningKind::Parameters, message));
    }
}

/// A length byte followed by text, truncated if incomplete.
fn counted(body: &[u8]) -> Text {
    match body.split_first() {
        Some((&length, rest)) => Text(rest[..usize::from(length).min(rest.len())].to_vec()),
        None => Text::default(),
    }
}

/// Type, dimensions, elements, description.
fn parse_body(body: &[u8], order: ByteOrder) -> Result<(Vec<u8>, Values, Text), String> {
    let [kind, n_dimensions, rest @ ..] = body else {
        return Err(format!("{} bytes are left for type and dimensions", body.len()));
    };
    let n_dimensions = usize::from(*n_dimensions);
    if n_dimensions > rest.len() {
        return Err(format!("{n_dimensions} dimensions, {} bytes are left", rest.len()));
    }
    let (dimensions, rest) = rest.split_at(n_dimensions);
    let kind = *kind as i8;
    let size = match kind {
        -1 | 1 => 1,
        2 => 2,
        4 => 4,
        other => return Err(format!("type {other}, expected -1, 1, 2 or 4")),
    };
    let count = product(dimensions);
    let needed = count.saturating_mul(size);
    if needed > rest.len() {
        return Err(format!(
            "dimensions {dimensions:?} of {size}-byte elements need {needed} bytes, {} are there",
            rest.len()
        ));
    }
    let (data, rest) = rest.split_at(needed);
    let values = match kind {
        -1 => Values::Text(data.to_vec()),
        1 => Values::Bytes(data.to_vec()),
        2 => Values::Integers(data.chunks_exact(2).map(|c| order.u16([c[0], c[1]]) as i16).collect()),
        _ => Values::Floats(data.chunks_exact(4).map(|c| order.f32([c[0], c[1], c[2], c[3]])).collect()),
    };
    Ok((dimensions.to_vec(), values, counted(rest)))
}
