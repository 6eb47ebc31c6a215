//! The files of a study.

use pe_flow::failure::Failure;

use super::view::View;
use super::{page, picture};
use crate::explore::columns;
use crate::explore::sheet::Sheet;
use crate::output::Files;

/// All files of a study.
///
/// # Errors
/// If the picture cannot be rasterised.
pub fn files(sheet: &Sheet) -> Result<Files, Failure> {
    let view = View::new(sheet);
    let svg = picture::work_precision(&view);
    let png = pe_plot::raster::png(&svg).map_err(|error| Failure::Internal(format!("work-precision.png: {error}")))?;
    let cells = view.cells();
    Ok(vec![
        ("accuracy.json", view.json().into_bytes()),
        ("accuracy.csv", columns::csv(&page::COLUMNS, &cells).into_bytes()),
        ("work-precision.svg", svg.into_bytes()),
        ("work-precision.png", png),
        ("index.html", page::page(&view, &cells).into_bytes()),
    ])
}
