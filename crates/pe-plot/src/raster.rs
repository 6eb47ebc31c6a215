//! Pictures as PNG files, for readers and programs that do not show SVG.
//!
//! The font is part of the program (DejaVu Sans, reduced to the characters of our pictures), so that the same picture
//! gives the same bytes on every machine.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

/// Pixels per point of a picture: text of 11 points stays sharp on a screen of twice the usual density.
pub const PIXELS_PER_POINT: f32 = 2.0;

/// The fonts of the pictures, normal and bold. `fonts/LICENSE.txt` is their licence.
const FONTS: [&[u8]; 2] = [include_bytes!("../fonts/sans.ttf"), include_bytes!("../fonts/sans-bold.ttf")];

/// The bytes of the PNG file that shows a picture of ours.
///
/// # Errors
/// A message if `svg` is no picture, or larger than memory allows.
pub fn png(svg: &str) -> Result<Vec<u8>, String> {
    let mut fonts = fontdb::Database::new();
    FONTS.iter().for_each(|font| fonts.load_font_data(font.to_vec()));
    fonts.set_sans_serif_family("DejaVu Sans");
    let options = Options { fontdb: Arc::new(fonts), font_family: "DejaVu Sans".to_owned(), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|error| error.to_string())?;
    let side = |points: f32| (points * PIXELS_PER_POINT).ceil() as u32;
    let (width, height) = (side(tree.size().width()), side(tree.size().height()));
    let mut pixels = Pixmap::new(width, height).ok_or_else(|| format!("no memory for {width} x {height} pixels"))?;
    let scale = Transform::from_scale(PIXELS_PER_POINT, PIXELS_PER_POINT);
    resvg::render(&tree, scale, &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Scale;
    use crate::chart::{AxisPlan, Chart, Series};
    use crate::style::Look;

    fn chart(label: &str) -> String {
        let chart = Chart {
            title: "T".to_owned(),
            x: AxisPlan::new(label, Scale::Log),
            y: AxisPlan::new("y", Scale::Log),
            series: vec![Series::new("points", Look::markers(0), [(1.0, 2.0), (10.0, 20.0)])],
            field: None,
            height: 100.0,
        };
        chart.draw("", 200.0)
    }

    #[test]
    fn a_picture_has_its_size_and_its_text() {
        let with_text = png(&chart("seconds")).unwrap();
        assert_eq!(&with_text[1..4], b"PNG");
        assert_eq!(u32::from_be_bytes(with_text[16..20].try_into().unwrap()), 400);
        assert_eq!(with_text, png(&chart("seconds")).unwrap());
        assert_ne!(with_text, png(&chart("minutes")).unwrap(), "text is not drawn");
        assert!(png("no picture").is_err());
    }
}
