//! Typed keys: the constants by which keys are read, as [`crate::keys!`] declares them.
//!
//! A reader names a key by its constant, such as `keys::Silence::policy`. A name that is no key, a key of another
//! table, and a value of another type do not compile.

use std::marker::PhantomData;

use super::format::{KeySpec, Section};

/// Key of the group `G` with a value of the type `T`, one of [`kinds`].
#[derive(Debug)]
pub struct TypedKey<G, T> {
    name: &'static str,
    marker: PhantomData<fn() -> (G, T)>,
}

impl<G, T> TypedKey<G, T> {
    /// Creates the constant of a key. Only [`crate::keys!`] calls it, next to the row of the key.
    pub const fn new(name: &'static str) -> TypedKey<G, T> {
        TypedKey { name, marker: PhantomData }
    }

    /// Returns the name of the key.
    pub const fn name(self) -> &'static str {
        self.name
    }
}

impl<G, T> Clone for TypedKey<G, T> {
    fn clone(&self) -> TypedKey<G, T> {
        *self
    }
}

impl<G, T> Copy for TypedKey<G, T> {}

/// Group of keys, declared by [`crate::keys!`].
pub trait KeyGroup {
    /// Returns the rows of the keys, in the order of the reference page.
    fn rows() -> Vec<KeySpec>;
}

/// Table of a format, declared by [`crate::tables!`].
pub trait TableFormat {
    /// Name of the table's section.
    const NAME: &'static str;
    /// Description of the table, in one line.
    const DESCRIPTION: &'static str;

    /// Returns the rows of all groups of the table.
    fn rows() -> Vec<KeySpec>;
}

/// Creates the section of a table, with the keys of its groups.
pub fn table_section<T: TableFormat>() -> Section {
    Section::new(T::NAME, T::DESCRIPTION, T::rows())
}

/// Implemented by tables that have the keys of the group `G`.
#[diagnostic::on_unimplemented(
    message = "the table `{Self}` has no key of the group `{G}`",
    label = "a key of another table"
)]
pub trait HasGroup<G> {}

/// Types of the values of keys, one for each [`super::format::ValueType`]. They exist at compile time only.
#[expect(missing_docs, reason = "the variants of `ValueType` describe them")]
pub mod kinds {
    use std::marker::PhantomData;

    macro_rules! kinds {
        ($($kind:ident)*) => { $(#[derive(Debug)] pub enum $kind {})* };
    }

    kinds!(Text Kind Law Method Boolean Number Time Times Integer Pair Points Texts Names NamesOrCount Any);

    /// Words of which each means a value of the type `W`.
    #[derive(Debug)]
    pub struct Word<W>(PhantomData<W>);
    #[derive(Debug)]
    pub struct Table<S>(PhantomData<S>);
    #[derive(Debug)]
    pub struct FileOrTable<S>(PhantomData<S>);
    #[derive(Debug)]
    pub struct Tables<S>(PhantomData<S>);
    #[derive(Debug)]
    pub struct NamedTables<S>(PhantomData<S>);
}
