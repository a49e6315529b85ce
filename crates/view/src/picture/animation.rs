//! Moving pictures: the only file that names gif and its palette.

use color_quant::NeuQuant;

use crate::picture::{Camera, Picture};
use crate::{Error, Recording};

/// The palette is learned from so many frames, and has so many colours; one index stands for what
/// has not changed.
const LEARNED: usize = 6;
const COLOURS: usize = 255;
const SAME: u8 = 255;

impl Recording {
    /// The frames that a film of `rate` pictures a second shows: for each the last one that is not
    /// later, and the very last.
    ///
    /// # Panics
    /// When the rate is not positive.
    pub fn film(&self, rate: f64) -> Vec<usize> {
        assert!(rate > 0.0, "pictures a second must be positive");
        let times = self.times();
        let (Some(first), Some(last)) = (times.first(), times.last()) else {
            return Vec::new();
        };
        let count = ((last - first) * rate).round() as usize;
        let mut frames: Vec<usize> = (0..count)
            .map(|k| {
                let time = first + (k as f64 + 1e-6) / rate;
                times.partition_point(|t| *t <= time) - 1
            })
            .collect();
        frames.push(times.len() - 1);
        frames.dedup();
        frames
    }

    /// `count` frames from the first to the last, between which the cloth moves equally far: the sum
    /// over the steps of how far its nodes go, root mean square. Of a cloth that does not move, each
    /// is the first.
    pub fn key_frames(&self, count: usize) -> Vec<usize> {
        let Some(last) = self.frame_count().checked_sub(1) else {
            return Vec::new();
        };
        let mut ways = vec![0.0];
        for frame in 1..=last {
            let nodes = self.positions(frame - 1).iter().zip(self.positions(frame));
            let squared: f64 = nodes.map(|(p, q)| p.distance_squared(*q)).sum();
            ways.push(ways[frame - 1] + squared.sqrt());
        }
        let share = |k: usize| k as f64 / count.saturating_sub(1).max(1) as f64;
        let frame = |k: usize| match share(k) * ways[last] {
            way if k + 1 == count && way > 0.0 => last,
            way => ways.partition_point(|w| *w < way),
        };
        (0..count).map(frame).collect()
    }

    /// The bytes of an animated GIF that repeats, `rate` pictures a second (50 at most: what
    /// programs that show GIFs keep up with), 255 colours in all.
    ///
    /// # Errors
    /// As for [`picture`](Self::picture); [`Error::Draw`] for a rate out of range, a side of more
    /// than 65535 pixels, or a recording without frames.
    pub fn gif(
        &self,
        camera: &Camera,
        width: u32,
        height: u32,
        rate: f64,
    ) -> Result<Vec<u8>, Error> {
        if !(rate > 0.0 && rate <= 50.0) {
            let reason = format!("{rate} pictures a second, must be above 0 and 50 at most");
            return Err(Error::Draw(reason));
        }
        let draw = |frame: usize| self.picture(frame, camera, width, height);
        let frames = self.film(rate);
        let learned = self.key_frames(LEARNED);
        let pictures: Vec<Picture> = learned.into_iter().map(draw).collect::<Result<_, _>>()?;
        let mut palette = Palette::of(&pictures);
        let failed = |error: gif::EncodingError| Error::Draw(error.to_string());

        let [wide, high] = [width, height].map(u16::try_from);
        let (Ok(wide), Ok(high)) = (wide, high) else {
            return Err(Error::Draw("a side of more than 65535 pixels".into()));
        };
        let mut bytes = Vec::new();
        let mut encoder =
            gif::Encoder::new(&mut bytes, wide, high, &palette.bytes).map_err(failed)?;
        encoder.set_repeat(gif::Repeat::Infinite).map_err(failed)?;
        let delay = (100.0 / rate).round() as u16;
        let mut before = vec![SAME; width as usize * height as usize];
        for (k, &frame) in frames.iter().enumerate() {
            let mut indices = palette.indices(&draw(frame)?);
            let last = k + 1 == frames.len();
            let mut frame = changed(&before, &mut indices, wide, high);
            // The end stands still for two seconds.
            frame.delay = if last { 200 } else { delay };
            encoder.write_frame(&frame).map_err(failed)?;
            before = indices;
        }
        drop(encoder);
        Ok(bytes)
    }
}

/// The smallest rectangle that holds all that is new, what is old in it transparent.
fn changed(before: &[u8], now: &mut [u8], width: u16, height: u16) -> gif::Frame<'static> {
    let wide = usize::from(width);
    let (mut left, mut right, mut top, mut bottom) = (wide - 1, 0, usize::from(height) - 1, 0);
    for (k, (old, new)) in before.iter().zip(&*now).enumerate() {
        if old != new {
            (left, right) = (left.min(k % wide), right.max(k % wide));
            (top, bottom) = (top.min(k / wide), bottom.max(k / wide));
        }
    }
    if left > right {
        // A picture of one pixel that stays: a frame has to have one.
        (left, right, top, bottom) = (0, 0, 0, 0);
    }
    let mut buffer = Vec::with_capacity((right - left + 1) * (bottom - top + 1));
    for row in top..=bottom {
        for k in row * wide + left..=row * wide + right {
            buffer.push(if before[k] == now[k] { SAME } else { now[k] });
        }
    }
    gif::Frame {
        left: left as u16,
        top: top as u16,
        width: (right - left + 1) as u16,
        height: (bottom - top + 1) as u16,
        buffer: buffer.into(),
        transparent: Some(SAME),
        dispose: gif::DisposalMethod::Keep,
        ..gif::Frame::default()
    }
}

/// Colours that stand for all, and which one for which.
struct Palette {
    quantiser: NeuQuant,
    /// Red, green, blue of each; the last one is for what is transparent.
    bytes: Vec<u8>,
    /// By the six upper bits of each; what is not yet known is none.
    known: Vec<Option<u8>>,
}

impl Palette {
    fn of(pictures: &[Picture]) -> Self {
        // One pixel of three, with the opacity that the quantiser wants.
        let pixels = pictures
            .iter()
            .flat_map(|picture| picture.pixels.chunks_exact(3).step_by(3));
        let samples: Vec<u8> = pixels.flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let quantiser = NeuQuant::new(10, COLOURS, &samples);
        let mut bytes = quantiser.color_map_rgb();
        bytes.resize(3 * (COLOURS + 1), 0);
        // The background is most of a picture: exactly its colour.
        let white = quantiser.index_of(&[255; 4]);
        bytes[3 * white..][..3].fill(255);
        Self {
            quantiser,
            bytes,
            known: vec![None; 1 << 18],
        }
    }

    fn indices(&mut self, picture: &Picture) -> Vec<u8> {
        let mut index = |pixel: &[u8]| {
            let key = pixel
                .iter()
                .fold(0, |key, value| key << 6 | usize::from(value >> 2));
            *self.known[key].get_or_insert_with(|| {
                let middle = |value: u8| value & !3 | 2;
                let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(middle);
                self.quantiser.index_of(&[r, g, b, 255]) as u8
            })
        };
        picture.pixels.chunks_exact(3).map(&mut index).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::rising;

    #[test]
    fn films_and_key_frames_go_from_the_first_to_the_last() {
        let recording = rising(61, 1.0 / 60.0);
        let film = recording.film(20.0);
        assert_eq!((film.len(), &film[..3], film[20]), (21, &[0, 3, 6][..], 60));
        assert_eq!(recording.film(1000.0).len(), 61);
        assert_eq!(recording.key_frames(3), [0, 30, 60]);
        assert_eq!(recording.key_frames(1), [0]);
        assert_eq!(recording.key_frames(0), [0; 0]);
    }

    #[test]
    fn a_gif_shows_every_frame() {
        let recording = rising(61, 1.0 / 60.0);
        let camera = recording.camera(48, 36);
        let bytes = recording.gif(&camera, 48, 36, 10.0).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(std::io::Cursor::new(&bytes)).unwrap();
        let palette = decoder.global_palette().unwrap().to_vec();
        let mut shown = vec![0; 48 * 36];
        let mut count = 0;
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            for (k, &index) in frame.buffer.iter().enumerate() {
                let (x, y) = (k % usize::from(frame.width), k / usize::from(frame.width));
                if frame.transparent != Some(index) {
                    shown[(y + usize::from(frame.top)) * 48 + x + usize::from(frame.left)] = index;
                }
            }
            count += 1;
        }
        assert_eq!(count, 11);
        // What is left is the last frame, but for the size of the palette.
        let last = recording.picture(60, &camera, 48, 36).unwrap();
        for (pixel, &index) in last.pixels.chunks(3).zip(&shown) {
            let colour = &palette[3 * usize::from(index)..][..3];
            for (a, b) in pixel.iter().zip(colour) {
                assert!(a.abs_diff(*b) < 24, "{pixel:?} is shown as {colour:?}");
            }
        }
        assert_eq!(bytes, recording.gif(&camera, 48, 36, 10.0).unwrap());
        assert!(recording.gif(&camera, 48, 36, 0.0).is_err());
    }
}
