//! The JSON Schema of scenario files and of other formats of such rows, for editors and other programs: made of
//! the rows of [`crate::scenario::keys`], nothing else. A file that it accepts may still make no sense.

use protocol::catalog::Catalog;
use serde_json::{Map, Value, json};
use toml::de::DeValue;

use crate::scenario::keys::{Format, Key, Kind, Otherwise, Range, Section, Takes};
use crate::scenario::table::{NUMBER_MAX, SECONDS_MAX, spelled};

/// The schema for these laws and methods, as text with a newline at its end.
pub fn schema(catalog: &Catalog) -> String {
    let format = Format::of(catalog);
    let (mut schema, mut definitions) = parts(&format, "A Phalanx scenario");
    schema["anyOf"] = json!([{ "required": ["robot"] }, { "required": ["graph"] }]);
    // Laws of the scenario's own have names and gains that no schema knows.
    for name in ["robot", "robot_defaults"] {
        let mut own = definitions[name].clone();
        own["properties"]["law"] = json!({ "type": "string" });
        own["additionalProperties"] = number(Range::Positive, NUMBER_MAX);
        definitions.insert(format!("{name}_with_laws"), own);
    }
    let robots = |with: &str| {
        let reference = |name: &str| json!({ "$ref": format!("#/definitions/{name}{with}") });
        json!({ "properties": {
            "robot": { "items": reference("robot") },
            "robot_defaults": reference("robot_defaults"),
        } })
    };
    for name in ["robot", "robot_defaults"] {
        let says = schema["properties"][name]["description"].clone();
        schema["properties"][name] = json!({ "description": says });
    }
    schema["properties"]["robot"]["type"] = "array".into();
    schema["if"] = json!({ "required": ["laws"] });
    schema["then"] = robots("_with_laws");
    schema["else"] = robots("");
    text(schema, definitions)
}

/// The schema of another format with this title, as text with a newline at its end. A section without keys takes any.
pub fn of(format: &Format, title: &str) -> String {
    let (schema, definitions) = parts(format, title);
    text(schema, definitions)
}

fn parts(format: &Format, title: &str) -> (Value, Map<String, Value>) {
    let (root, others) = format.sections.split_first().expect("the whole file is a section");
    let mut schema = table(root, format);
    schema["$schema"] = "http://json-schema.org/draft-07/schema#".into();
    schema["title"] = title.into();
    let definitions =
        others.iter().map(|section| (section.name.to_owned(), table(section, format)));
    (schema, definitions.collect())
}

fn text(mut schema: Value, definitions: Map<String, Value>) -> String {
    schema["definitions"] = Value::Object(definitions);
    serde_json::to_string_pretty(&schema).expect("JSON has a text") + "\n"
}

fn table(section: &Section, format: &Format) -> Value {
    if section.kinds.is_empty() {
        let needed = section.keys.iter().filter(|key| needed(section, key)).map(|key| key.name);
        return object(
            section.says,
            &section.keys.iter().collect::<Vec<_>>(),
            needed.collect(),
            format,
        );
    }
    let kinds = section.kinds.iter().map(|kind| of_kind(section, kind, format));
    json!({ "description": section.says, "oneOf": kinds.collect::<Vec<Value>>() })
}

fn of_kind(section: &Section, kind: &Kind, format: &Format) -> Value {
    let keys: Vec<&Key> = section.keys.iter().filter(|key| kind.has(key.name)).collect();
    let by_default = section.key("kind").is_some_and(|row| match &row.otherwise {
        Otherwise::Default(word) => word.as_str() == Some(kind.word),
        _ => false,
    });
    let said = (!by_default).then_some("kind");
    let needed = said.into_iter().chain(kind.needs.iter().copied());
    let mut object = object(kind.says, &keys, needed.collect(), format);
    object["properties"]["kind"] = json!({ "const": kind.word });
    object
}

/// Whether a key must be in this very table: robots have keys from `robot_defaults` and from the
/// nodes of an imported graph too, which may be all robots there are.
fn needed(section: &Section, key: &Key) -> bool {
    let elsewhere = match section.name {
        "scenario" => key.name == "robot",
        "robot" => key.name != "name",
        "robot_defaults" => true,
        _ => false,
    };
    matches!(key.otherwise, Otherwise::Needed) && !elsewhere
}

fn object(says: &str, keys: &[&Key], needed: Vec<&str>, format: &Format) -> Value {
    let mut properties = Map::new();
    for key in keys {
        let value = value(key, format);
        for old in key.was {
            let mut value = value.clone();
            value["deprecated"] = true.into();
            value["description"] = format!("old name of `{}`", key.name).into();
            properties.insert((*old).to_owned(), value);
        }
        properties.insert(key.name.to_owned(), value);
    }
    json!({
        "type": "object",
        "description": says,
        "properties": properties,
        "required": needed,
        "additionalProperties": keys.is_empty(),
    })
}

fn value(key: &Key, format: &Format) -> Value {
    let pair = json!({
        "type": "array",
        "items": { "type": "number" },
        "minItems": 2,
        "maxItems": 2,
    });
    let reference = |section: &str| json!({ "$ref": format!("#/definitions/{section}") });
    let mut value = match key.takes {
        Takes::Text => json!({ "type": "string" }),
        Takes::Word(words) => {
            json!({ "enum": words.iter().map(|(word, _)| word).collect::<Vec<_>>() })
        }
        Takes::Kind => json!({ "type": "string" }),
        Takes::Law => json!({ "enum": format.laws }),
        Takes::Method => json!({ "enum": format.methods }),
        Takes::Truth => json!({ "type": "boolean" }),
        Takes::Number(range) => number(range, NUMBER_MAX),
        Takes::Time(range) => number(range, SECONDS_MAX),
        Takes::Times => {
            json!({ "type": "array", "items": number(Range::NotNegative, SECONDS_MAX) })
        }
        Takes::Whole(least, most) => {
            json!({ "type": "integer", "minimum": least, "maximum": most })
        }
        Takes::Pair => pair,
        Takes::Points => json!({ "type": "array", "items": pair }),
        Takes::Texts | Takes::Names => json!({ "type": "array", "items": { "type": "string" } }),
        Takes::NamesOrCount => json!({
            "type": ["array", "integer"],
            "items": { "type": "string" },
            "minimum": 0,
        }),
        // What stands beside a reference is not looked at: hence the list of one.
        Takes::Table(section) => json!({ "allOf": [reference(section)] }),
        Takes::Tables(section) => json!({ "type": "array", "items": reference(section) }),
        Takes::NamedTables(section) => {
            json!({ "type": "object", "additionalProperties": reference(section) })
        }
        Takes::Any(_) => json!({}),
    };
    let mut says = key.says.to_string();
    if !key.unit().is_empty() {
        says += &format!(" [{}]", key.unit());
    }
    if let Takes::Word(words) = key.takes {
        for (word, meaning) in words.iter().filter(|(_, meaning)| !meaning.is_empty()) {
            says += &format!("; {word}: {meaning}");
        }
    }
    match &key.otherwise {
        Otherwise::Rule(rule) => says += &format!("; without it: {rule}"),
        Otherwise::Default(default) => value["default"] = in_json(default),
        Otherwise::Needed | Otherwise::Absent => {}
    }
    value["description"] = says.into();
    value
}

/// A default: a number, a word, true or false.
fn in_json(default: &DeValue<'_>) -> Value {
    match default {
        DeValue::String(word) => word.as_ref().into(),
        DeValue::Boolean(truth) => (*truth).into(),
        number => spelled(number).parse::<serde_json::Number>().expect("a number").into(),
    }
}

fn number(range: Range, most: f64) -> Value {
    match range {
        Range::Any => json!({ "type": "number", "minimum": -most, "maximum": most }),
        Range::NotNegative => json!({ "type": "number", "minimum": 0, "maximum": most }),
        Range::Positive => json!({ "type": "number", "exclusiveMinimum": 0, "maximum": most }),
        Range::NotZero => {
            json!({ "type": "number", "minimum": -most, "maximum": most, "not": { "const": 0 } })
        }
    }
}
