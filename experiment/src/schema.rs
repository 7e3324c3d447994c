//! JSON Schema of scenario files and of the other formats, for editors and other programs. It is generated from the
//! rows of [`crate::scenario::keys`]. A file that matches the schema may still be rejected by `phalanx check`.

use protocol::catalog::Catalog;
use serde_json::{Map, Value, json};
use toml::de::DeValue;

use crate::scenario::keys::{
    FileFormat, IfMissing, KeySpec, KindSpec, NumberRange, Section, ValueType,
};
use crate::scenario::table::{NUMBER_MAX, SECONDS_MAX, format_as_toml};

/// Returns the scenario schema for the control laws and avoidance methods of `catalog`, with a newline at the end.
pub fn scenario_schema(catalog: &Catalog) -> String {
    let format = FileFormat::new(catalog);
    let (mut schema, mut definitions) = schema_and_definitions(&format, "A Phalanx scenario");
    schema["anyOf"] = json!([{ "required": ["robot"] }, { "required": ["graph"] }]);
    // The scenario chooses the names and gains of its external laws.
    for name in ["robot", "robot_defaults"] {
        let mut definition = definitions[name].clone();
        definition["properties"]["law"] = json!({ "type": "string" });
        definition["additionalProperties"] = number_schema(NumberRange::Positive, NUMBER_MAX);
        definitions.insert(format!("{name}_with_laws"), definition);
    }
    let robots = |suffix: &str| {
        let reference = |name: &str| json!({ "$ref": format!("#/definitions/{name}{suffix}") });
        json!({ "properties": {
            "robot": { "items": reference("robot") },
            "robot_defaults": reference("robot_defaults"),
        } })
    };
    for name in ["robot", "robot_defaults"] {
        let description = schema["properties"][name]["description"].clone();
        schema["properties"][name] = json!({ "description": description });
    }
    schema["properties"]["robot"]["type"] = "array".into();
    schema["if"] = json!({ "required": ["laws"] });
    schema["then"] = robots("_with_laws");
    schema["else"] = robots("");
    schema_text(schema, definitions)
}

/// Returns the schema of `format` with this title, with a newline at the end. A section without keys accepts any key.
pub fn schema_for_format(format: &FileFormat, title: &str) -> String {
    let (schema, definitions) = schema_and_definitions(format, title);
    schema_text(schema, definitions)
}

/// Returns the schema of the top-level table and the definitions of the other sections.
fn schema_and_definitions(format: &FileFormat, title: &str) -> (Value, Map<String, Value>) {
    let (root, others) = format.sections.split_first().expect("the top-level table is a section");
    let mut schema = table_schema(root, format);
    schema["$schema"] = "http://json-schema.org/draft-07/schema#".into();
    schema["title"] = title.into();
    let definitions =
        others.iter().map(|section| (section.name.to_owned(), table_schema(section, format)));
    (schema, definitions.collect())
}

fn schema_text(mut schema: Value, definitions: Map<String, Value>) -> String {
    schema["definitions"] = Value::Object(definitions);
    serde_json::to_string_pretty(&schema).expect("JSON has a text") + "\n"
}

fn table_schema(section: &Section, format: &FileFormat) -> Value {
    if section.kinds.is_empty() {
        let needed = section
            .keys
            .iter()
            .filter(|key| is_required_in_table(section, key))
            .map(|key| key.name);
        return object_schema(
            section.description,
            &section.keys.iter().collect::<Vec<_>>(),
            needed.collect(),
            format,
        );
    }
    let kinds = section.kinds.iter().map(|kind| kind_schema(section, kind, format));
    json!({ "description": section.description, "oneOf": kinds.collect::<Vec<Value>>() })
}

/// Returns the schema of the tables of one kind.
fn kind_schema(section: &Section, kind: &KindSpec, format: &FileFormat) -> Value {
    let keys: Vec<&KeySpec> = section.keys.iter().filter(|key| kind.allows_key(key.name)).collect();
    let is_default_kind = section.find_key("kind").is_some_and(|row| match &row.if_missing {
        IfMissing::Default(word) => word.as_str() == Some(kind.name),
        _ => false,
    });
    let required = (!is_default_kind).then_some("kind");
    let needed = required.into_iter().chain(kind.required_keys.iter().copied());
    let mut object = object_schema(kind.description, &keys, needed.collect(), format);
    object["properties"]["kind"] = json!({ "const": kind.name });
    object
}

/// Returns whether `key` is required in this table itself. The keys of robots can also be in `robot_defaults` and in
/// the nodes of an imported graph, which can supply all robots.
fn is_required_in_table(section: &Section, key: &KeySpec) -> bool {
    let may_be_inherited = match section.name {
        "scenario" => key.name == "robot",
        "robot" => key.name != "name",
        "robot_defaults" => true,
        _ => false,
    };
    matches!(key.if_missing, IfMissing::Required) && !may_be_inherited
}

fn object_schema(
    description: &str,
    keys: &[&KeySpec],
    needed: Vec<&str>,
    format: &FileFormat,
) -> Value {
    let mut properties = Map::new();
    for key in keys {
        let value = value_schema(key, format);
        for old in key.old_names {
            let mut value = value.clone();
            value["deprecated"] = true.into();
            value["description"] = format!("former name of `{}`", key.name).into();
            properties.insert((*old).to_owned(), value);
        }
        properties.insert(key.name.to_owned(), value);
    }
    json!({
        "type": "object",
        "description": description,
        "properties": properties,
        "required": needed,
        "additionalProperties": keys.is_empty(),
    })
}

fn value_schema(key: &KeySpec, format: &FileFormat) -> Value {
    let pair = json!({
        "type": "array",
        "items": { "type": "number" },
        "minItems": 2,
        "maxItems": 2,
    });
    let reference = |section: &str| json!({ "$ref": format!("#/definitions/{section}") });
    let mut value = match key.value_type {
        ValueType::Text => json!({ "type": "string" }),
        ValueType::Word(words) => {
            json!({ "enum": words.iter().map(|(word, _)| word).collect::<Vec<_>>() })
        }
        ValueType::Kind => json!({ "type": "string" }),
        ValueType::Law => json!({ "enum": format.law_names }),
        ValueType::Method => json!({ "enum": format.method_names }),
        ValueType::Boolean => json!({ "type": "boolean" }),
        ValueType::Number(range) => number_schema(range, NUMBER_MAX),
        ValueType::Time(range) => number_schema(range, SECONDS_MAX),
        ValueType::Times => {
            json!({ "type": "array", "items": number_schema(NumberRange::NotNegative, SECONDS_MAX) })
        }
        ValueType::Integer(min, max) => {
            json!({ "type": "integer", "minimum": min, "maximum": max })
        }
        ValueType::Pair => pair,
        ValueType::Points => json!({ "type": "array", "items": pair }),
        ValueType::Texts | ValueType::Names => {
            json!({ "type": "array", "items": { "type": "string" } })
        }
        ValueType::NamesOrCount => json!({
            "type": ["array", "integer"],
            "items": { "type": "string" },
            "minimum": 0,
        }),
        // A schema ignores the siblings of `$ref`, such as the description. Hence `allOf` with one element.
        ValueType::Table(section) => json!({ "allOf": [reference(section)] }),
        ValueType::FileOrTable(section) => {
            json!({ "anyOf": [{ "type": "string" }, reference(section)] })
        }
        ValueType::Tables(section) => json!({ "type": "array", "items": reference(section) }),
        ValueType::NamedTables(section) => {
            json!({ "type": "object", "additionalProperties": reference(section) })
        }
        ValueType::Any(_) => json!({}),
    };
    let mut description = key.description.to_string();
    if !key.unit().is_empty() {
        description += &format!(" [{}]", key.unit());
    }
    if let ValueType::Word(words) = key.value_type {
        for (word, meaning) in words.iter().filter(|(_, meaning)| !meaning.is_empty()) {
            description += &format!("; {word}: {meaning}");
        }
    }
    match &key.if_missing {
        IfMissing::Rule(rule) => description += &format!("; if not given: {rule}"),
        IfMissing::Default(default) => value["default"] = default_to_json(default),
        IfMissing::Required | IfMissing::Absent => {}
    }
    value["description"] = description.into();
    value
}

/// Converts a default value (number, string or boolean) to JSON.
fn default_to_json(default: &DeValue<'_>) -> Value {
    match default {
        DeValue::String(word) => word.as_ref().into(),
        DeValue::Boolean(value) => (*value).into(),
        number => format_as_toml(number).parse::<serde_json::Number>().expect("a number").into(),
    }
}

fn number_schema(range: NumberRange, max: f64) -> Value {
    match range {
        NumberRange::Any => json!({ "type": "number", "minimum": -max, "maximum": max }),
        NumberRange::NotNegative => json!({ "type": "number", "minimum": 0, "maximum": max }),
        NumberRange::Positive => json!({ "type": "number", "exclusiveMinimum": 0, "maximum": max }),
        NumberRange::NotZero => {
            json!({ "type": "number", "minimum": -max, "maximum": max, "not": { "const": 0 } })
        }
    }
}
