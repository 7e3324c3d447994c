//! Declaration of the quantities of a run: one place for the key of `summary.json`, its text, its row on screen and
//! page, and its column of a campaign's table. The reference page follows from it, too.

/// Key of `summary.json`.
#[derive(Debug, Clone, Copy)]
pub struct Quantity {
    /// Name of the key.
    pub name: &'static str,
    /// Text for the reference page, as in the doc comment of the field.
    pub text: &'static str,
}

/// Row of the facts on screen and page.
#[derive(Debug)]
pub struct Fact<S> {
    /// Label at the left of the row.
    pub label: &'static str,
    /// Function that returns the text; `None` if the row is left out.
    pub text: fn(&S) -> Option<String>,
}

/// Column of `runs.csv` that a summary determines.
#[derive(Debug)]
pub struct SummaryColumn<S> {
    /// Name of the column.
    pub name: &'static str,
    /// Text for the reference page.
    pub text: &'static str,
    /// Function that returns the field of a run whose scenario has this minimum distance d, m.
    pub value: fn(&S, f64) -> String,
}

/// Returns a table of names and texts for the reference page, in Markdown.
pub fn reference_table<'q>(head: &str, rows: impl Iterator<Item = (&'q str, &'q str)>) -> String {
    let rows = rows.map(|(name, text)| format!("| `{name}` | {} |\n", text.trim()));
    format!("| {head} | meaning |\n|---|---|\n{}", rows.collect::<String>())
}

/// Declares the struct of `summary.json`, then the rows on screen and page and the columns of `runs.csv`, each in its
/// order. A row or column begins with a field, which must exist.
macro_rules! quantities {
    (
        $(#[$meta:meta])*
        pub struct $Summary:ident {
            $(
                $(#[doc = $text:literal])+
                $(#[serde($($serde:tt)*)])?
                pub $field:ident: $type:ty
            ),* $(,)?
        }
        facts |$fact_of:ident| {
            $( $fact_field:ident $label:literal = $fact:expr ),* $(,)?
        }
        columns |$column_of:ident, $d_m:ident| {
            $( $column:ident $($column_text:literal)? = $value:expr ),* $(,)?
        }
    ) => {
        $(#[$meta])*
        pub struct $Summary {
            $(
                $(#[doc = $text])+
                $(#[serde($($serde)*)])?
                pub $field: $type,
            )*
        }

        /// Texts of the keys, by name.
        #[allow(dead_code, reason = "only some keys are columns")]
        struct Texts {
            $( $field: &'static str, )*
        }

        const TEXTS: Texts = Texts {
            $( $field: concat!($($text),+), )*
        };

        impl $Summary {
            /// Keys of `summary.json`, in order.
            pub const QUANTITIES: &'static [$crate::quantities::Quantity] = &[$(
                $crate::quantities::Quantity { name: stringify!($field), text: concat!($($text),+) },
            )*];

            /// Rows of the facts on screen and page, in order.
            pub const FACTS: &'static [$crate::quantities::Fact<$Summary>] = &[$(
                $crate::quantities::Fact {
                    label: {
                        let _ = |summary: $Summary| summary.$fact_field;
                        $label
                    },
                    text: |$fact_of: &$Summary| $fact,
                },
            )*];

            /// Columns of `runs.csv`, in order.
            pub const COLUMNS: &'static [$crate::quantities::SummaryColumn<$Summary>] = &[$(
                $crate::quantities::SummaryColumn {
                    name: stringify!($column),
                    text: $crate::quantities::quantities!(@text $column $($column_text)?),
                    value: |$column_of: &$Summary, $d_m: f64| {
                        let _ = ($column_of, $d_m);
                        $value
                    },
                },
            )*];
        }
    };
    (@text $column:ident) => { TEXTS.$column };
    (@text $column:ident $text:literal) => { $text };
}
pub(crate) use quantities;
