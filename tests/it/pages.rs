//! README and book: what they show runs and does what they say.
//!
//! `book` follows the pages, and `reference` compares lists with what there is. The others are about
//! `docs/add-*.md`, whose code, word for word, compiles: each module stands in for the `mod.rs` that
//! its page adds a row to; the files that the page shows are in the folder of the same name.

mod avoidance;
mod book;
mod law;
mod reference;
mod role;
mod tutorial;

/// The blocks of Rust in a page, in order.
fn blocks(page: &str) -> Vec<&str> {
    let starts = page.split("```rust\n").skip(1);
    starts.map(|rest| rest.split("```").next().expect("an end")).collect()
}

/// That a page's block with a row in it stands in `here`, and the list that it adds to in `there`.
#[track_caller]
fn assert_row(block: &str, here: &str, there: &str) {
    assert!(here.contains(block), "not in the test: {block}");
    let (list, _) = block.rsplit_once(" = ").expect("a list");
    let list = list.lines().last().unwrap();
    assert!(there.contains(list), "the list is not there: {list}");
}
