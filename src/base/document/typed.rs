//! Typed values from parsed TOML.
//!
//! The deserialiser of the crate `toml` hands tables to a type in three forms (tables, values with spans, dates), so
//! that each type is compiled three times. This one has tables alone.

use std::fmt;
use std::ops::Range;

use schemars::JsonSchema;
use serde::de::value::StrDeserializer;
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, IntoDeserializer, MapAccess, SeqAccess,
    Unexpected, VariantAccess, Visitor,
};
use toml::Spanned;
use toml::de::{DeFloat, DeInteger, DeString, DeTable, DeValue};

use super::Source;
use super::lists::in_place_of_table;

/// What a text says against TOML or the type that it is read as, and where: bytes of the text.
#[derive(Clone, Debug)]
pub(super) struct Mismatch {
    pub message: String,
    pub span: Option<Range<usize>>,
}

impl Mismatch {
    /// The same at a place, unless it has one.
    fn at(mut self, span: Range<usize>) -> Self {
        self.span.get_or_insert(span);
        self
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Mismatch {}

impl de::Error for Mismatch {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self {
            message: message.to_string(),
            span: None,
        }
    }
}

/// Reads a text and its settings as a type.
pub(super) fn read<T: DeserializeOwned + JsonSchema + 'static>(source: &Source) -> Result<T, Mismatch> {
    let file = source.document()?;
    match in_place_of_table::<T>(&file) {
        None => T::deserialize(Value(file)),
        Some((span, key)) => Err(Mismatch {
            message: format!("`{key}`: found a list, expected a table"),
            span: Some(span),
        }),
    }
}

pub(super) fn parsed(text: &str) -> Result<Spanned<DeValue<'_>>, Mismatch> {
    let root = DeTable::parse(text).map_err(|error| Mismatch {
        message: error.message().to_owned(),
        span: error.span(),
    })?;
    Ok(Spanned::new(root.span(), DeValue::Table(root.into_inner())))
}

fn signed(number: &DeInteger<'_>) -> Option<i64> {
    i64::from_str_radix(number.as_str(), number.radix()).ok()
}

fn unsigned(number: &DeInteger<'_>) -> Option<u64> {
    u64::from_str_radix(number.as_str(), number.radix()).ok()
}

/// The number, unless it is infinite without being written so.
fn finite(number: &DeFloat<'_>) -> Option<f64> {
    let text = number.as_str();
    text.parse()
        .ok()
        .filter(|number: &f64| number.is_finite() || text.contains(['i', 'n']))
}

struct Value<'i>(Spanned<DeValue<'i>>);

impl<'de> Value<'de> {
    /// The value of a type.
    fn of<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, Mismatch> {
        let span = self.0.span();
        seed.deserialize(self).map_err(|error| error.at(span))
    }
}

impl<'de> Deserializer<'de> for Value<'de> {
    type Error = Mismatch;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mismatch> {
        match self.0.into_inner() {
            DeValue::String(text) => visitor.visit_str(&text),
            DeValue::Integer(number) => match (signed(&number), unsigned(&number)) {
                (Some(number), _) => visitor.visit_i64(number),
                (None, Some(number)) => visitor.visit_u64(number),
                (None, None) => {
                    let integer = format!("integer `{number}`");
                    Err(de::Error::invalid_type(Unexpected::Other(&integer), &visitor))
                }
            },
            DeValue::Float(number) => match finite(&number) {
                Some(number) => visitor.visit_f64(number),
                None => Err(de::Error::custom("floating-point number overflowed")),
            },
            DeValue::Boolean(value) => visitor.visit_bool(value),
            DeValue::Datetime(_) => Err(de::Error::invalid_type(Unexpected::Other("a date"), &visitor)),
            DeValue::Array(values) => visitor.visit_seq(Values(values.into_iter())),
            DeValue::Table(table) => visitor.visit_map(Table {
                entries: table.into_iter(),
                value: None,
            }),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mismatch> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Mismatch> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mismatch> {
        let is_variant = |table: &DeTable| table.keys().all(|key| variants.contains(&key.get_ref().as_ref()));
        match self.0.into_inner() {
            DeValue::String(name) => visitor.visit_enum(name.as_ref().into_deserializer()),
            DeValue::Table(table) if table.len() == 1 && is_variant(&table) => visitor.visit_enum(Table {
                entries: table.into_iter(),
                value: None,
            }),
            DeValue::Table(_) => {
                let words = variants.join("\" or \"");
                Err(de::Error::custom(format_args!("found a table, expected \"{words}\"")))
            }
            _ => Err(de::Error::custom("wanted string or table")),
        }
    }

    serde::forward_to_deserialize_any! {
        bool u8 u16 u32 u64 i8 i16 i32 i64 f32 f64 char str string seq bytes byte_buf map unit ignored_any unit_struct tuple_struct
        tuple identifier struct
    }
}

struct Values<'i>(std::vec::IntoIter<Spanned<DeValue<'i>>>);

impl<'de> SeqAccess<'de> for Values<'de> {
    type Error = Mismatch;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Mismatch> {
        self.0.next().map(|value| Value(value).of(seed)).transpose()
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

struct Table<'i> {
    entries: toml::map::IntoIter<Spanned<DeString<'i>>, Spanned<DeValue<'i>>>,
    /// Value of the last key.
    value: Option<Spanned<DeValue<'i>>>,
}

impl<'de> Table<'de> {
    fn next<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Mismatch> {
        let Some((key, value)) = self.entries.next() else {
            return Ok(None);
        };
        self.value = Some(value);
        let name: StrDeserializer<'_, Mismatch> = key.as_ref().as_ref().into_deserializer();
        seed.deserialize(name).map(Some).map_err(|error| error.at(key.span()))
    }

    fn value(&mut self) -> Result<Value<'de>, Mismatch> {
        self.value
            .take()
            .map(Value)
            .ok_or_else(|| de::Error::custom("a value without a key"))
    }
}

impl<'de> MapAccess<'de> for Table<'de> {
    type Error = Mismatch;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Mismatch> {
        self.next(seed)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Mismatch> {
        self.value()?.of(seed)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.entries.len())
    }
}

/// A variant and its content: the only entry of a table.
impl<'de> EnumAccess<'de> for Table<'de> {
    type Error = Mismatch;
    type Variant = Value<'de>;

    fn variant_seed<K: DeserializeSeed<'de>>(mut self, seed: K) -> Result<(K::Value, Value<'de>), Mismatch> {
        match self.next(seed)? {
            Some(name) => Ok((name, self.value()?)),
            None => Err(de::Error::custom("wanted string or table")),
        }
    }
}

impl<'de> VariantAccess<'de> for Value<'de> {
    type Error = Mismatch;

    fn unit_variant(self) -> Result<(), Mismatch> {
        Err(de::Error::custom("wanted string or table"))
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Mismatch> {
        self.of(seed)
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Mismatch> {
        self.deserialize_any(visitor)
    }

    fn struct_variant<V: Visitor<'de>>(self, _: &'static [&'static str], visitor: V) -> Result<V::Value, Mismatch> {
        self.deserialize_any(visitor)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use schemars::JsonSchema;
    use serde::Deserialize;

    use super::*;

    fn read<T: DeserializeOwned + JsonSchema + 'static>(text: &str) -> Result<T, Mismatch> {
        super::read(&Source::new("x", text, &[]))
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(rename_all = "kebab-case")]
    enum Choice {
        Plain,
        Number(f64),
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct All {
        seed: Option<u64>,
        size: Option<f64>,
        names: Option<Vec<String>>,
        is_on: Option<bool>,
        choice: Option<Choice>,
        inner: Option<BTreeMap<String, [i32; 2]>>,
    }

    /// A law as files have them: a table with `kind`.
    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(tag = "kind", rename_all = "kebab-case")]
    enum Law {
        Neo { rate: f64 },
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    struct Holder {
        inner: Option<Inner>,
        law: Option<Law>,
        laws: Option<Vec<Law>>,
        named: Option<BTreeMap<String, Inner>>,
        point: Option<(f64, f64)>,
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    struct Inner {
        #[serde(default)]
        rate: f64,
    }

    #[test]
    fn a_list_in_place_of_a_table_is_refused_at_its_place() {
        for (text, key, place) in [
            ("inner = []", "inner", 8..10),
            ("inner = [3.0]", "inner", 8..13),
            ("law = [\"neo\", 3.0]", "law", 6..18),
            ("laws = [[\"neo\", 3.0]]", "laws", 8..20),
            ("[named]\na = [2.0]", "named.a", 12..17),
        ] {
            let refused = read::<Holder>(text).expect_err(text);
            let message = format!("`{key}`: found a list, expected a table");
            assert_eq!((refused.message, refused.span), (message, Some(place)), "{text}");
        }
        for text in [
            "inner = { rate = 3.0 }",
            "point = [1.0, 2.0]",
            "laws = [{ kind = \"neo\", rate = 1.0 }]",
            "[named.a]\nrate = 2.0",
        ] {
            assert!(read::<Holder>(text).is_ok(), "{text}");
        }
    }

    #[test]
    fn values_and_errors_are_those_of_the_crate_toml() {
        for text in [
            "",
            "seed = 18446744073709551615\nsize = 1e-3\nnames = [\"a\", \"b\\n\"]\nis_on = true",
            "size = inf\nchoice = \"plain\"\n[inner]\na = [1, -2]\nb = [0x10, 0]",
            "choice = { number = 2.5 }",
            "seed = -1",
            "size = \"wide\"",
            "names = [\"a\", 3]",
            "choice = \"other\"",
            "choice = 3",
            "[inner]\na = [1]",
            "is_on = 1\n",
            "\nsead = 3",
            "size = ",
        ] {
            let expected = toml::from_str::<All>(text).map_err(|error| (error.message().to_owned(), error.span()));
            let table = read::<All>(text).map_err(|error| (error.message, error.span));
            assert_eq!(table, expected, "{text}");
        }
        let date = read::<All>("size = 2026-01-31").unwrap_err();
        assert_eq!(
            (&*date.message, date.span),
            ("invalid type: a date, expected f64", Some(7..17))
        );
    }
}
