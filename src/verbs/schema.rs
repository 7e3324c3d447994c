//! `phalanx schema`: the JSON Schema of scenario files.

use protocol::catalog::Catalog;

use super::screen::{Output, print_as};
use experiment::schema;

pub(super) fn schema(catalog: &Catalog) -> u8 {
    print_as(Output::Json, &schema::schema(catalog))
}
