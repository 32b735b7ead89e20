//! Numbers that are not defined: NaN in memory, `null` in a JSON file.
//!
//! JSON has no NaN. `serde_json` writes `null` for it and then refuses to read `null` where a
//! number is expected, so that a file could be written that nothing reads. Every file of a
//! workspace is read through [`Undefined`], which takes `null` for NaN wherever a floating-point
//! number is expected; whole numbers, texts and lists are as strict as before.
//!
//! One place is out of its reach: where serde has to hold a value before it knows its type
//! (`flatten`, `untagged`, `tag`), it no longer sees what is expected. Such a type takes an
//! `Option<f64>` there, or is read by [`crate::json::from_value`] in a second step.

use serde::de::{DeserializeSeed, Deserializer, EnumAccess, Error, MapAccess, SeqAccess, VariantAccess, Visitor};
use std::fmt;

/// A deserializer that reads `null` as NaN where a floating-point number is expected.
pub(crate) struct Undefined<T>(pub T);

/// Hands a call on, with the visitor wrapped, so that what is inside is read in the same way.
macro_rules! hand_on {
    ($($name:ident($($arg:ident: $kind:ty),*);)*) => {
        $(fn $name<V: Visitor<'de>>(self, $($arg: $kind,)* visitor: V) -> Result<V::Value, D::Error> {
            self.0.$name($($arg,)* Undefined(visitor))
        })*
    };
}

impl<'de, D: Deserializer<'de>> Deserializer<'de> for Undefined<D> {
    type Error = D::Error;

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, D::Error> {
        self.0.deserialize_option(Number(visitor))
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, D::Error> {
        self.deserialize_f64(visitor)
    }

    fn is_human_readable(&self) -> bool {
        self.0.is_human_readable()
    }

    hand_on! {
        deserialize_any();
        deserialize_bool();
        deserialize_i8();
        deserialize_i16();
        deserialize_i32();
        deserialize_i64();
        deserialize_i128();
        deserialize_u8();
        deserialize_u16();
        deserialize_u32();
        deserialize_u64();
        deserialize_u128();
        deserialize_char();
        deserialize_str();
        deserialize_string();
        deserialize_bytes();
        deserialize_byte_buf();
        deserialize_option();
        deserialize_unit();
        deserialize_unit_struct(name: &'static str);
        deserialize_newtype_struct(name: &'static str);
        deserialize_seq();
        deserialize_tuple(len: usize);
        deserialize_tuple_struct(name: &'static str, len: usize);
        deserialize_map();
        deserialize_struct(name: &'static str, fields: &'static [&'static str]);
        deserialize_enum(name: &'static str, variants: &'static [&'static str]);
        deserialize_identifier();
        deserialize_ignored_any();
    }
}

/// Visitor for a number that may be absent.
struct Number<V>(V);

impl<'de, V: Visitor<'de>> Visitor<'de> for Number<V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.expecting(f)
    }
    fn visit_none<E: Error>(self) -> Result<V::Value, E> {
        self.0.visit_f64(f64::NAN)
    }
    fn visit_unit<E: Error>(self) -> Result<V::Value, E> {
        self.0.visit_f64(f64::NAN)
    }
    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<V::Value, D::Error> {
        deserializer.deserialize_f64(self.0)
    }
}

/// Hands a scalar on.
macro_rules! scalars {
    ($($name:ident: $kind:ty;)*) => {
        $(fn $name<E: Error>(self, value: $kind) -> Result<V::Value, E> {
            self.0.$name(value)
        })*
    };
}

impl<'de, V: Visitor<'de>> Visitor<'de> for Undefined<V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.expecting(f)
    }
    fn visit_none<E: Error>(self) -> Result<V::Value, E> {
        self.0.visit_none()
    }
    fn visit_unit<E: Error>(self) -> Result<V::Value, E> {
        self.0.visit_unit()
    }
    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<V::Value, D::Error> {
        self.0.visit_some(Undefined(deserializer))
    }
    fn visit_newtype_struct<D: Deserializer<'de>>(self, deserializer: D) -> Result<V::Value, D::Error> {
        self.0.visit_newtype_struct(Undefined(deserializer))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, all: A) -> Result<V::Value, A::Error> {
        self.0.visit_seq(Undefined(all))
    }
    fn visit_map<A: MapAccess<'de>>(self, all: A) -> Result<V::Value, A::Error> {
        self.0.visit_map(Undefined(all))
    }
    fn visit_enum<A: EnumAccess<'de>>(self, one: A) -> Result<V::Value, A::Error> {
        self.0.visit_enum(Undefined(one))
    }

    scalars! {
        visit_bool: bool;
        visit_i64: i64;
        visit_i128: i128;
        visit_u64: u64;
        visit_u128: u128;
        visit_f64: f64;
        visit_char: char;
        visit_str: &str;
        visit_borrowed_str: &'de str;
        visit_string: String;
        visit_bytes: &[u8];
        visit_borrowed_bytes: &'de [u8];
        visit_byte_buf: Vec<u8>;
    }
}

impl<'de, S: DeserializeSeed<'de>> DeserializeSeed<'de> for Undefined<S> {
    type Value = S::Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<S::Value, D::Error> {
        self.0.deserialize(Undefined(deserializer))
    }
}

impl<'de, A: SeqAccess<'de>> SeqAccess<'de> for Undefined<A> {
    type Error = A::Error;

    fn next_element_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, A::Error> {
        self.0.next_element_seed(Undefined(seed))
    }
    fn size_hint(&self) -> Option<usize> {
        self.0.size_hint()
    }
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Undefined<A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, A::Error> {
        self.0.next_key_seed(seed)
    }
    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        self.0.next_value_seed(Undefined(seed))
    }
    fn size_hint(&self) -> Option<usize> {
        self.0.size_hint()
    }
}

impl<'de, A: EnumAccess<'de>> EnumAccess<'de> for Undefined<A> {
    type Error = A::Error;
    type Variant = Undefined<A::Variant>;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, Self::Variant), A::Error> {
        let (name, content) = self.0.variant_seed(seed)?;
        Ok((name, Undefined(content)))
    }
}

impl<'de, A: VariantAccess<'de>> VariantAccess<'de> for Undefined<A> {
    type Error = A::Error;

    fn unit_variant(self) -> Result<(), A::Error> {
        self.0.unit_variant()
    }
    fn newtype_variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, A::Error> {
        self.0.newtype_variant_seed(Undefined(seed))
    }
    fn tuple_variant<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, A::Error> {
        self.0.tuple_variant(len, Undefined(visitor))
    }
    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, A::Error> {
        self.0.struct_variant(fields, Undefined(visitor))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use crate::json::from_slice;
    use serde::{Deserialize, Serialize};
    use std::collections::BTreeMap;

    #[derive(Debug, Serialize, Deserialize)]
    enum Kind {
        Bare,
        One(f64),
        Two(f32, f64),
        Named { value: f64, perhaps: Option<f64> },
    }

    #[derive(Debug, Serialize, Deserialize)]
    struct Inner(f64);

    #[derive(Debug, Serialize, Deserialize)]
    struct All {
        plain: f64,
        single: f32,
        list: Vec<f64>,
        fixed: [f64; 3],
        pair: (String, f64),
        map: BTreeMap<String, f64>,
        numbered: BTreeMap<u32, f64>,
        inner: Inner,
        kinds: Vec<Kind>,
        perhaps: Option<f64>,
        nested: Option<Vec<Option<[f64; 2]>>>,
        count: usize,
        word: String,
    }

    #[test]
    fn regress_an_undefined_number_is_written_and_read_back_wherever_it_stands() {
        let n = f64::NAN;
        let all = All {
            plain: n,
            single: f32::NAN,
            list: vec![n, 1.5, n],
            fixed: [n; 3],
            pair: ("x".into(), n),
            map: [("a".into(), n)].into(),
            numbered: [(1, n)].into(),
            inner: Inner(n),
            kinds: vec![Kind::Bare, Kind::One(n), Kind::Two(f32::NAN, n), Kind::Named { value: n, perhaps: None }],
            perhaps: None,
            nested: Some(vec![None, Some([n, 2.0])]),
            count: 3,
            word: "null".into(),
        };
        let text = serde_json::to_vec(&all).unwrap();
        assert!(serde_json::from_slice::<All>(&text).is_err(), "the plain reader refuses it");
        let back: All = from_slice(&text).unwrap();
        assert!(back.plain.is_nan() && back.inner.0.is_nan() && back.list[0].is_nan() && back.perhaps.is_none());
        assert_eq!(serde_json::to_vec(&back).unwrap(), text);
        // only numbers may be undefined
        for (field, word) in [("\"count\":3", "\"count\":null"), ("\"word\":\"null\"", "\"word\":null")] {
            let wrong = String::from_utf8(text.clone()).unwrap().replace(field, word);
            assert!(from_slice::<All>(wrong.as_bytes()).is_err(), "{word}");
        }
        assert!(from_slice::<All>(&[&text[..], b"x"].concat()).is_err(), "what follows is no part of it");
    }
}
