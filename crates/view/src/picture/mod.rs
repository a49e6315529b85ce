//! Pictures of a recording, drawn on the processor: no display is needed.

mod animation;
mod camera;
mod draw;
mod raster;

use crate::Error;

pub use camera::Camera;

/// Red, green and blue from 0 to 1, as a screen takes them (sRGB).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Colour(pub(crate) [f32; 3]);

impl Colour {
    const fn rgb(red: u8, green: u8, blue: u8) -> Self {
        Self([
            red as f32 / 255.0,
            green as f32 / 255.0,
            blue as f32 / 255.0,
        ])
    }

    fn times(self, factor: f64) -> Self {
        Self(self.0.map(|value| (value * factor as f32).min(1.0)))
    }
}

/// A picture: three bytes a pixel, red, green, blue, row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `3 * width * height` bytes.
    pub pixels: Vec<u8>,
}

impl Picture {
    /// The bytes of a PNG file; the same picture gives the same bytes.
    ///
    /// # Errors
    /// [`Error::Draw`] for a picture without pixels.
    pub fn png(&self) -> Result<Vec<u8>, Error> {
        let encode = || -> Result<Vec<u8>, png::EncodingError> {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_compression(png::Compression::High);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&self.pixels)?;
            writer.finish()?;
            Ok(bytes)
        };
        encode().map_err(|error| Error::Draw(error.to_string()))
    }

    /// A white picture.
    pub fn blank([width, height]: [u32; 2]) -> Self {
        let pixels = vec![255; 3 * width as usize * height as usize];
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Pictures of one height side by side.
    ///
    /// # Panics
    /// When their heights differ.
    pub fn beside(pictures: &[Self]) -> Self {
        let height = pictures.first().map_or(0, |first| first.height);
        assert!(
            pictures.iter().all(|picture| picture.height == height),
            "pictures side by side are of one height"
        );
        let mut pixels = Vec::new();
        for row in 0..height as usize {
            for picture in pictures {
                let width = 3 * picture.width as usize;
                pixels.extend_from_slice(&picture.pixels[row * width..][..width]);
            }
        }
        Self {
            width: pictures.iter().map(|picture| picture.width).sum(),
            height,
            pixels,
        }
    }

    /// Pictures of one width below each other.
    ///
    /// # Panics
    /// When their widths differ.
    pub fn below(pictures: &[Self]) -> Self {
        let width = pictures.first().map_or(0, |first| first.width);
        assert!(
            pictures.iter().all(|picture| picture.width == width),
            "pictures below each other are of one width"
        );
        Self {
            width,
            height: pictures.iter().map(|picture| picture.height).sum(),
            pixels: pictures
                .iter()
                .flat_map(|picture| picture.pixels.iter().copied())
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_side_by_side_and_below() {
        let one = |pixels: &[u8]| Picture {
            width: 1,
            height: 2,
            pixels: pixels.to_vec(),
        };
        let (a, b) = (one(&[1, 1, 1, 2, 2, 2]), one(&[3, 3, 3, 4, 4, 4]));
        let beside = Picture::beside(&[a.clone(), b.clone()]);
        assert_eq!((beside.width, beside.height), (2, 2));
        assert_eq!(beside.pixels, [1, 1, 1, 3, 3, 3, 2, 2, 2, 4, 4, 4]);
        let below = Picture::below(&[a, b]);
        assert_eq!((below.width, below.height), (1, 4));
        assert_eq!(below.pixels, [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4]);
        assert!(Picture::beside(&[]).png().is_err());
    }

    #[test]
    fn a_png_holds_what_was_drawn() {
        let picture = Picture {
            width: 3,
            height: 2,
            pixels: (0..18).collect(),
        };
        let bytes = picture.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(pixels, picture.pixels);
    }
}
