//! The guard against its proof: the formulas that the lemmas of the folder `proof` speak of, read from
//! there and evaluated, say what the guard does. Whoever changes one of the two has to change the other.

use std::collections::HashMap;
use std::f64::consts::PI;

use formation::Vec2;
use formation::front_point::rotate;
use proptest::prelude::*;

use super::tests::brief;
use super::*;

const SOURCES: [&str; 2] = [
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Geometry.v")),
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../proof/Guard.v")),
];

/// Functions of real numbers that a Coq file defines: `Definition name (a b : R) : R := body.`
struct Formulas<'a>(HashMap<&'a str, (Vec<&'a str>, Vec<&'a str>)>);

impl<'a> Formulas<'a> {
    fn read(sources: &[&'a str]) -> Formulas<'a> {
        let definitions = sources.iter().flat_map(|source| source.split("\nDefinition ").skip(1));
        let formulas = definitions.filter_map(|text| {
            let (head, rest) = text.split_once(":=")?;
            let (body, _) = rest.split_once('.')?;
            let mut head = tokens(head).into_iter();
            let name = head.next()?;
            // The types stand between a colon and a parenthesis.
            let mut in_type = false;
            let arguments = head.filter(|token| {
                in_type = *token == ":" || in_type && *token != "(";
                !in_type && !matches!(*token, "(" | ")")
            });
            Some((name, (arguments.collect(), tokens(body))))
        });
        Formulas(formulas.collect())
    }

    fn value(&self, name: &str, arguments: &[f64]) -> f64 {
        let (names, body) = self.0.get(name).unwrap_or_else(|| panic!("{name} is not defined"));
        assert_eq!(names.len(), arguments.len(), "arguments of {name}");
        let known = names.iter().copied().zip(arguments.iter().copied()).collect();
        let mut reader = Reader { formulas: self, known, rest: body };
        let value = reader.sum();
        assert!(reader.rest.is_empty(), "{name} ends before {:?}", reader.rest);
        value
    }

    /// How many arguments `name` takes, if it is a function.
    fn arity(&self, name: &str) -> Option<usize> {
        match name {
            "Rmax" | "Rmin" => Some(2),
            "exp" | "cos" | "sin" | "asin" | "INR" => Some(1),
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
            ("INR", [a]) => *a,
            _ => self.value(name, arguments),
        }
    }
}

fn tokens(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let word = |c: char| c.is_alphanumeric() || c == '_' || c == '\'';
        let length = if word(first) {
            rest.find(|c| !word(c)).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        let (token, after) = rest.split_at(length);
        found.push(token);
        rest = after.trim_start();
    }
    found
}

/// Evaluates a Coq expression from left to right.
struct Reader<'a> {
    formulas: &'a Formulas<'a>,
    known: HashMap<&'a str, f64>,
    rest: &'a [&'a str],
}

impl<'a> Reader<'a> {
    fn next(&mut self) -> &'a str {
        let (first, rest) = self.rest.split_first().expect("the expression goes on");
        self.rest = rest;
        first
    }

    fn take(&mut self, token: &str) -> bool {
        let there = self.rest.first() == Some(&token);
        if there {
            self.next();
        }
        there
    }

    fn expect(&mut self, token: &str) {
        assert!(self.take(token), "expected {token} before {:?}", self.rest);
    }

    fn sum(&mut self) -> f64 {
        if self.take("if") {
            self.expect("Rlt_dec");
            let less = self.atom() < self.atom();
            self.expect("then");
            let then = self.sum();
            self.expect("else");
            let otherwise = self.sum();
            return if less { then } else { otherwise };
        }
        let mut value = self.product();
        loop {
            if self.take("+") {
                value += self.product();
            } else if self.take("-") {
                value -= self.product();
            } else {
                return value;
            }
        }
    }

    fn product(&mut self) -> f64 {
        let mut value = self.application();
        loop {
            if self.take("*") {
                value *= self.application();
            } else if self.take("/") {
                value /= self.application();
            } else {
                return value;
            }
        }
    }

    fn application(&mut self) -> f64 {
        if self.take("-") {
            return -self.application();
        }
        let name = self.rest.first().filter(|name| !self.known.contains_key(*name));
        match name.and_then(|name| self.formulas.arity(name)) {
            None => self.atom(),
            Some(arity) => {
                let name = self.next();
                let arguments: Vec<f64> = (0..arity).map(|_| self.atom()).collect();
                self.formulas.call(name, &arguments)
            }
        }
    }

    fn atom(&mut self) -> f64 {
        match self.next() {
            "(" => {
                let value = self.sum();
                self.expect(")");
                value
            }
            "PI" => PI,
            token => match self.known.get(token) {
                Some(value) => *value,
                None => token.parse().unwrap_or_else(|_| panic!("what is {token}?")),
            },
        }
    }
}

/// T = 10 ms, H = 25 ms, ell = 0.1 m.
fn guard(d: f64, v_max: f64, sensing_error: f64, heading_error: f64) -> Guard {
    let mut brief = brief();
    brief.avoidance.distance_min_m = d;
    brief.avoidance.speed_max_m_s = v_max;
    brief.avoidance.sensing_error_m = sensing_error;
    brief.avoidance.heading_error_rad = heading_error;
    Guard::new(&brief)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn the_formulas_of_the_guard_are_those_of_the_proof(
        d in 0.1..0.4f64,
        v_max in 0.1..2.0f64,
        own_share in 0.0..=1.0f64,
        sensing_error in prop_oneof![Just(0.0), 0.0..0.02f64],
        heading_error in prop_oneof![Just(0.0), 0.0..0.2f64],
        // The distance beyond d, in units of v_max H.
        far in -2.0..4.0f64,
        direction in -3.2..3.2f64,
        heading in -3.2..3.2f64,
        turns in (-1.0..=0.0f64, 0.0..=1.0f64),
    ) {
        let mut guard = guard(d, v_max, sensing_error, heading_error);
        let (ell, lifetime) = (guard.ell, guard.lifetime);
        let proof = Formulas::read(&SOURCES);
        let say = |name: &str, arguments: &[f64]| proof.value(name, arguments);

        let (w_low, w_high) = (turns.0 * v_max / ell, turns.1 * v_max / ell);
        let (mid, spread) = guard.headings(heading, w_low, w_high);
        let (proven_mid, proven_spread) = (
            say("middle", &[heading, lifetime, w_low, w_high]),
            say("spread", &[lifetime, w_low, w_high, heading_error]),
        );
        prop_assert!((mid - proven_mid).abs() < 1e-12);
        prop_assert!((spread - proven_spread).abs() < 1e-12);

        let v_own = own_share * v_max;
        let r = (d + far * v_max * lifetime).max(0.0);
        guard.collect_sides(&[rotate(direction, Vec2::new(r, 0.0))], v_own, spread);

        let eps = sensing_error + say("front_error", &[ell, heading_error]);
        let m = say("reach", &[v_max, v_own, lifetime, eps]);
        let rho = say("slack", &[r, eps, d, ROUNDING_M]);
        let b = say("bound", &[lifetime, rho, m]);
        if (b - v_own).abs() < 1e-9 {
            return Ok(()); // Rounding may decide whether it matters.
        }
        if b >= v_own {
            prop_assert!(guard.sides.is_empty());
            return Ok(());
        }
        let psi = say("psi", &[spread, say("swing", &[m, r])]);
        let count = say("count", &[psi]);
        prop_assert_eq!(guard.sides.len() as f64, count);
        for (q, side) in guard.sides.iter().enumerate() {
            let angle = say("side_angle", &[psi, count, q as f64]);
            // At r = 0 any direction is as good.
            let n = rotate(if r > 0.0 { direction } else { 0.0 }, Vec2::new(1.0, 0.0));
            prop_assert!((side.normal - rotate(angle, n)).norm() < 1e-9);
            prop_assert!((side.bound - say("side_bound", &[b, psi, count])).abs() < 1e-9);
        }
    }

    #[test]
    fn whoever_is_not_sensed_is_as_far_away_as_the_proof_wants_it(
        d in 0.1..0.4f64, v_max in 0.1..2.0f64, errors in (0.0..0.02f64, 0.0..0.2f64),
    ) {
        let guard = guard(d, v_max, errors.0, errors.1);
        let far = Formulas::read(&SOURCES).value("far", &[d, v_max, guard.lifetime]);
        prop_assert!(guard.radius_needed - guard.distance_error >= far - 1e-12);
    }
}

#[test]
fn what_is_taken_off_for_rounding_only_helps() {
    // `proof/Guard.v::sensible`.
    const { assert!(ROUNDING_M >= 0.0) };
}
