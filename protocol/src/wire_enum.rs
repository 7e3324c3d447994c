//! Enums with a number on the wire and a keyword in files, both declared once.

/// Declares an enum with a number on the wire and a keyword for each variant: `Value = number "keyword"`.
macro_rules! wire_enum {
    ($(#[$doc:meta])* $name:ident: $number:ident {
        $($(#[$value_doc:meta])* $value:ident = $n:literal $keyword:literal,)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        #[repr($number)]
        pub enum $name { $($(#[$value_doc])* $value = $n,)+ }

        impl $name {
            /// All values, in the order of their numbers.
            pub const ALL: [$name; [$($n),+].len()] = [$($name::$value),+];

            /// Returns the value with a number; `None` if there is none.
            pub fn from_number(number: $number) -> Option<$name> {
                match number {
                    $($n => Some($name::$value),)+
                    _ => None,
                }
            }

            /// Returns the keyword in files.
            pub fn keyword(self) -> &'static str {
                match self {
                    $($name::$value => $keyword,)+
                }
            }
        }
    };
}

/// Returns the nonzero counts with their keywords. `counts` is indexed by number.
pub(crate) fn nonzero_counts<const N: usize>(
    keywords: [&'static str; N],
    counts: &[u64],
) -> impl Iterator<Item = (&'static str, u64)> {
    keywords.into_iter().zip(counts.to_vec()).filter(|&(_, count)| count > 0)
}

#[cfg(test)]
mod tests {
    use crate::dropped::DropReason;
    use crate::goal::RefusalReason;
    use crate::message::{Phase, PolledState, ReceptionState, WantedState};
    use crate::stage::{LatenessCause, Stage};

    /// Numbers are indices of lists, and keywords are columns: neither may change.
    #[test]
    fn values_have_consecutive_numbers_and_unique_words() {
        fn check<T: PartialEq + std::fmt::Debug>(
            all: &[T],
            index: impl Fn(&T) -> usize,
            from_number: impl Fn(usize) -> Option<T>,
            keyword: impl Fn(&T) -> &'static str,
        ) {
            let keywords: std::collections::BTreeSet<_> = all.iter().map(keyword).collect();
            assert_eq!(keywords.len(), all.len(), "{keywords:?}");
            for (number, value) in all.iter().enumerate() {
                assert_eq!((index(value), from_number(number).as_ref()), (number, Some(value)));
            }
            assert_eq!(from_number(all.len()), None);
        }
        check(
            &ReceptionState::ALL,
            |c| *c as usize,
            |n| ReceptionState::from_number(n as u64),
            |c| c.keyword(),
        );
        check(&Phase::ALL, |p| *p as usize, |n| Phase::from_number(n as u64), |p| p.keyword());
        check(
            &WantedState::ALL,
            |w| *w as usize,
            |n| WantedState::from_number(n as u64),
            |w| w.keyword(),
        );
        check(
            &PolledState::ALL,
            |p| *p as usize,
            |n| PolledState::from_number(n as u64),
            |p| p.keyword(),
        );
        check(&Stage::ALL, |s| *s as usize, |n| Stage::from_number(n as u32), |s| s.keyword());
        check(&DropReason::ALL, |d| *d as usize, DropReason::from_number, |d| d.keyword());
        check(&RefusalReason::ALL, |r| *r as usize, RefusalReason::from_number, |r| r.keyword());
        let late: Vec<&str> =
            LatenessCause::ALL.iter().map(|cause| cause.stage().keyword()).collect();
        assert_eq!(late, ["late_work", "late_core", "late_faults", "late_host", "late_unknown"]);
    }
}
