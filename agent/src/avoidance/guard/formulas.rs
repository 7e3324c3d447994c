//! Parser and evaluator for formulas of the folder `proof`, for tests that compare them with the code.

use std::collections::HashMap;
use std::f64::consts::PI;

/// Real functions defined in a Coq file: `Definition name (a b : R) : R := body.`
pub struct Formulas<'a>(HashMap<&'a str, (Vec<&'a str>, Vec<&'a str>)>);

impl<'a> Formulas<'a> {
    /// Reads all definitions of real functions in the sources.
    pub fn read(sources: &[&'a str]) -> Formulas<'a> {
        let definitions = sources.iter().flat_map(|source| source.split("\nDefinition ").skip(1));
        let formulas = definitions.filter_map(|text| {
            let (head, rest) = text.split_once(":=")?;
            let (body, _) = rest.split_once('.')?;
            let mut head = tokenize(head).into_iter();
            let name = head.next()?;
            // A type extends from a colon to the next parenthesis.
            let mut in_type = false;
            let arguments = head.filter(|token| {
                in_type = *token == ":" || in_type && *token != "(";
                !in_type && !matches!(*token, "(" | ")")
            });
            Some((name, (arguments.collect(), tokenize(body))))
        });
        Formulas(formulas.collect())
    }

    /// Returns the value of `name` for these arguments. Panics if it is not defined or the number of arguments
    /// is wrong.
    pub fn evaluate(&self, name: &str, arguments: &[f64]) -> f64 {
        let (names, body) = self.0.get(name).unwrap_or_else(|| panic!("{name} is not defined"));
        assert_eq!(names.len(), arguments.len(), "arguments of {name}");
        let known = names.iter().copied().zip(arguments.iter().copied()).collect();
        let mut reader =
            ExpressionEvaluator { formulas: self, variables: known, remaining_tokens: body };
        let value = reader.parse_sum();
        assert!(
            reader.remaining_tokens.is_empty(),
            "{name} ends before {:?}",
            reader.remaining_tokens
        );
        value
    }

    /// Returns the number of arguments of `name`, or `None` if it is not a function.
    fn argument_count(&self, name: &str) -> Option<usize> {
        match name {
            "Rmax" | "Rmin" => Some(2),
            "exp" | "cos" | "sin" | "asin" | "Rabs" | "INR" => Some(1),
            _ => self.0.get(name).map(|(names, _)| names.len()),
        }
    }

    fn call(&self, name: &str, arguments: &[f64]) -> f64 {
        match (name, arguments) {
            ("Rmax", [a, b]) => a.max(*b),
            ("Rmin", [a, b]) => a.min(*b),
            ("exp", [a]) => a.exp(),
            ("cos", [a]) => a.cos(),
            ("sin", [a]) => a.sin(),
            ("asin", [a]) => a.asin(),
            ("Rabs", [a]) => a.abs(),
            ("INR", [a]) => *a,
            _ => self.evaluate(name, arguments),
        }
    }
}

fn tokenize(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let is_name_part = |c: char| c.is_alphanumeric() || c == '_' || c == '\'';
        let length = if is_name_part(first) {
            rest.find(|c| !is_name_part(c)).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        let (token, after) = rest.split_at(length);
        found.push(token);
        rest = after.trim_start();
    }
    found
}

/// Evaluates a Coq expression from left to right. Panics on invalid syntax.
struct ExpressionEvaluator<'a> {
    formulas: &'a Formulas<'a>,
    variables: HashMap<&'a str, f64>,
    remaining_tokens: &'a [&'a str],
}

impl<'a> ExpressionEvaluator<'a> {
    fn next_token(&mut self) -> &'a str {
        let (first, rest) = self.remaining_tokens.split_first().expect("the expression goes on");
        self.remaining_tokens = rest;
        first
    }

    fn accept_token(&mut self, token: &str) -> bool {
        let is_next = self.remaining_tokens.first() == Some(&token);
        if is_next {
            self.next_token();
        }
        is_next
    }

    fn expect_token(&mut self, token: &str) {
        assert!(self.accept_token(token), "expected {token} before {:?}", self.remaining_tokens);
    }

    fn parse_sum(&mut self) -> f64 {
        if self.accept_token("if") {
            let strictly = match self.next_token() {
                "Rlt_dec" => true,
                "Rle_dec" => false,
                other => panic!("{other} decides nothing"),
            };
            let (a, b) = (self.parse_atom(), self.parse_atom());
            let is_true = if strictly { a < b } else { a <= b };
            self.expect_token("then");
            let then = self.parse_sum();
            self.expect_token("else");
            let or_else = self.parse_sum();
            return if is_true { then } else { or_else };
        }
        let mut value = self.parse_product();
        loop {
            if self.accept_token("+") {
                value += self.parse_product();
            } else if self.accept_token("-") {
                value -= self.parse_product();
            } else {
                return value;
            }
        }
    }

    fn parse_product(&mut self) -> f64 {
        let mut value = self.parse_application();
        loop {
            if self.accept_token("*") {
                value *= self.parse_application();
            } else if self.accept_token("/") {
                value /= self.parse_application();
            } else {
                return value;
            }
        }
    }

    fn parse_application(&mut self) -> f64 {
        if self.accept_token("-") {
            return -self.parse_application();
        }
        let name = self.remaining_tokens.first().filter(|name| !self.variables.contains_key(*name));
        match name.and_then(|name| self.formulas.argument_count(name)) {
            None => self.parse_atom(),
            Some(arity) => {
                let name = self.next_token();
                let arguments: Vec<f64> = (0..arity).map(|_| self.parse_atom()).collect();
                self.formulas.call(name, &arguments)
            }
        }
    }

    fn parse_atom(&mut self) -> f64 {
        match self.next_token() {
            "(" => {
                let value = self.parse_sum();
                self.expect_token(")");
                value
            }
            "PI" => PI,
            token => match self.variables.get(token) {
                Some(value) => *value,
                None => token.parse().unwrap_or_else(|_| panic!("what is {token}?")),
            },
        }
    }
}
