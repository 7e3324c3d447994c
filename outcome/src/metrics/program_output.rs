//! Output of a program that computes metrics of a run.

use serde_json::{Map, Value};

/// Length of the output that an error shows, characters.
const SHOWN_CHARACTERS_MAX: usize = 80;

/// Parses the output of a program that computes metrics: one JSON object with a number or null for each metric.
/// Lines before the last one are ignored if the whole output is no object.
///
/// # Errors
///
/// If the output is no such object, or has other names. The text names the output and the remedy.
pub fn parse_metrics(output: &str, names: &[&str]) -> Result<Vec<(String, Option<f64>)>, String> {
    let expected = || {
        let example: Vec<String> = names.iter().map(|name| format!("\"{name}\": 0.5")).collect();
        format!("expected one JSON object, such as {{ {} }}", example.join(", "))
    };
    let last_line = output.trim().lines().last().unwrap_or_default();
    if last_line.is_empty() {
        return Err(format!("printed nothing; {}", expected()));
    }
    let parse = |text: &str| serde_json::from_str::<Map<String, Value>>(text);
    let object = parse(output).or_else(|_| parse(last_line)).map_err(|_| {
        let excerpt: String = last_line.chars().take(SHOWN_CHARACTERS_MAX).collect();
        let problem = match ["NaN", "Infinity"].iter().any(|word| last_line.contains(word)) {
            true => "a number that is not finite; print null for a metric without a value",
            false => "no JSON object",
        };
        format!("printed {excerpt:?}, {problem}; {}", expected())
    })?;
    if let Some(name) = object.keys().find(|name| !names.contains(&name.as_str())) {
        return Err(format!(
            "printed a value for {name:?}, which no table [metrics.{name}] with this program defines; {}",
            expected()
        ));
    }
    let value = |name: &&str| match object.get(*name) {
        None => Err(format!("printed no value for {name:?}; {}", expected())),
        Some(Value::Null) => Ok(((*name).to_owned(), None)),
        Some(value) => match value.as_f64().filter(|number| number.is_finite()) {
            Some(number) => Ok(((*name).to_owned(), Some(number))),
            None => Err(format!("printed {value} for {name:?}, expected a finite number or null")),
        },
    };
    names.iter().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn object_has_a_number_or_null_for_each_metric() {
        let parse = |output: &str| parse_metrics(output, &["cost_m2", "gap_m"]);
        let expected = vec![("cost_m2".to_owned(), Some(2.0)), ("gap_m".to_owned(), None)];
        assert_eq!(parse("{\"gap_m\": null, \"cost_m2\": 2}\n"), Ok(expected.clone()));
        assert_eq!(parse("reading\n{\"gap_m\": null, \"cost_m2\": 2.0}\n"), Ok(expected.clone()));
        assert_eq!(parse("{\n\"gap_m\": null,\n\"cost_m2\": 2.0\n}"), Ok(expected));
    }

    #[test]
    fn other_output_is_refused_with_the_remedy() {
        for (output, error) in [
            ("", "printed nothing; expected one JSON object, such as { \"cost_m2\": 0.5 }"),
            ("3.5", "printed \"3.5\", no JSON object; expected one"),
            ("{\"cost_m2\": NaN}", "a number that is not finite; print null"),
            ("{}", "printed no value for \"cost_m2\""),
            (
                "{\"cost_m2\": 1, \"cost\": 2}",
                "printed a value for \"cost\", which no table [metrics.cost]",
            ),
            (
                "{\"cost_m2\": true}",
                "printed true for \"cost_m2\", expected a finite number or null",
            ),
            ("{\"cost_m2\": [1]}", "printed [1] for \"cost_m2\""),
        ] {
            let found = parse_metrics(output, &["cost_m2"]).unwrap_err();
            assert!(found.contains(error), "{output}: {found}");
        }
    }
}
