//! Declaration of keys. [`crate::keys!`] takes one row for each key: name, type, range, default and description. The
//! row of the format, the constant by which the key is read, and the field of a struct of settings follow from it, so
//! that they cannot disagree.

/// Declares a group of keys, each by one row:
///
/// ```text
/// KEY: TYPE [as FIELD: RUST_TYPE] => .default("TOML", "description").with_bounds("range").with_synonyms("words");
/// ```
///
/// `.required`, `.default`, `.rule` or `.optional` comes first; see the methods of [`super::format::KeySpec`]. A row
/// with `as` becomes a field of the struct of settings that the head names, and is read into it.
#[macro_export]
macro_rules! keys {
    (
        $(#[$about:meta])*
        pub $group:ident $(, $(#[$settings_about:meta])* pub struct $settings:ident)?;
        $($key:ident: $kind:ident $(<$of:ty>)? $(($($arg:expr),*))? $(as $field:ident: $stored:ty)?
            => .$mode:ident $given:tt $(.$more:ident($($word:expr),*))*;)*
    ) => {
        $(#[$about])*
        #[derive(Debug)]
        pub enum $group {}

        #[expect(non_upper_case_globals, reason = "the constant of a key has its name")]
        #[allow(missing_docs, dead_code, reason = "the row describes the key; the format alone uses some")]
        impl $group {
            $(pub const $key: $crate::scenario::fields::TypedKey<
                $group,
                $crate::scenario::fields::kinds::$kind $(<$of>)?,
            > = $crate::scenario::fields::TypedKey::new(stringify!($key));)*
        }

        impl $crate::scenario::fields::KeyGroup for $group {
            fn rows() -> Vec<$crate::scenario::format::KeySpec> {
                vec![$($crate::scenario::format::key(
                    stringify!($key),
                    $crate::value_type!($kind $(<$of>)? $(($($arg),*))?),
                ).$mode $given $(.$more($($word),*))*),*]
            }
        }

        $crate::settings! {
            $group $($(#[$settings_about])* pub struct $settings)?;
            $($($field: $stored = $mode $key $given;)?)*
        }
    };
}

/// Declares the struct of settings of a group, and how it is read. Only [`crate::keys!`] calls it.
#[doc(hidden)]
#[macro_export]
macro_rules! settings {
    ($group:ident;) => {};
    (
        $group:ident $(#[$about:meta])* pub struct $settings:ident;
        $($field:ident: $stored:ty = $mode:ident $key:ident $given:tt;)*
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $settings {
            $(#[doc = concat!("Value of `", stringify!($key), "`: ", $crate::description! $given, ".")]
            pub $field: $stored,)*
        }

        impl $settings {
            /// Reads all settings.
            pub(crate) fn read<S: $crate::scenario::fields::HasGroup<$group>>(
                table: &$crate::scenario::table::TableReader<'_, S>,
            ) -> Result<$settings, $crate::scenario::diagnostic::Diagnostic> {
                Ok($settings { $($field: $crate::read_setting!($mode table $group::$key),)* })
            }
        }
    };
}

/// Returns the description of a row, its last argument. Only [`crate::keys!`] calls it.
#[doc(hidden)]
#[macro_export]
macro_rules! description {
    ($description:expr) => {
        $description
    };
    ($default:expr, $description:expr) => {
        $description
    };
}

/// Reads one setting. Only [`crate::keys!`] calls it.
#[doc(hidden)]
#[macro_export]
macro_rules! read_setting {
    (required $table:ident $key:expr) => {
        $crate::scenario::table::read_required($table, $key)?
    };
    (default $table:ident $key:expr) => {
        $crate::scenario::table::read_required($table, $key)?
    };
    ($optional:ident $table:ident $key:expr) => {
        $crate::scenario::table::read_optional($table, $key)?
    };
}

/// Returns the value type of a row. Only [`crate::keys!`] calls it.
#[doc(hidden)]
#[macro_export]
macro_rules! value_type {
    (Table<$table:ty>) => { $crate::value_type!(@ Table $table) };
    (Tables<$table:ty>) => { $crate::value_type!(@ Tables $table) };
    (FileOrTable<$table:ty>) => { $crate::value_type!(@ FileOrTable $table) };
    (NamedTables<$table:ty>) => { $crate::value_type!(@ NamedTables $table) };
    (@ $kind:ident $table:ty) => {
        $crate::scenario::format::ValueType::$kind(
            <$table as $crate::scenario::fields::TableFormat>::NAME,
        )
    };
    (Word<$word:ty>($words:expr)) => { $crate::scenario::format::ValueType::Word($words) };
    ($kind:ident $(($($arg:expr),*))?) => {
        $crate::scenario::format::ValueType::$kind $(($($arg),*))?
    };
}

/// Declares tables of a format: the section's name, its description, and the groups of keys that it has.
///
/// ```text
/// TABLE "name" "description" has GROUP, GROUP;
/// ```
#[macro_export]
macro_rules! tables {
    ($($table:ident $name:literal $description:literal has $($group:ident),*;)*) => {
        $(
            impl $crate::scenario::fields::TableFormat for $table {
                const NAME: &'static str = $name;
                const DESCRIPTION: &'static str = $description;

                fn rows() -> Vec<$crate::scenario::format::KeySpec> {
                    let groups: Vec<Vec<$crate::scenario::format::KeySpec>> =
                        vec![$(<$group as $crate::scenario::fields::KeyGroup>::rows()),*];
                    groups.concat()
                }
            }

            $(impl $crate::scenario::fields::HasGroup<$group> for $table {})*
        )*
    };
}
