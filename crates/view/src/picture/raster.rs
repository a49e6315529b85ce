//! Triangles, lines and discs on a picture with depth, several samples a pixel.

use crate::picture::Colour;

/// Samples along a side of a pixel.
const SAMPLES: u32 = 3;

/// A corner on the picture: x and y in samples, and how near it is.
pub(crate) type Corner = [f64; 3];

/// What is drawn so far.
#[derive(Debug)]
pub(crate) struct Raster {
    width: usize,
    height: usize,
    colours: Vec<[f32; 3]>,
    /// One over the depth of what is nearest, 0 for nothing.
    nearest: Vec<f32>,
    /// What a shadow falls on.
    shaded: Vec<bool>,
}

/// Samples in the width or height of a picture.
pub(crate) fn samples(pixels: u32) -> u32 {
    pixels * SAMPLES
}

impl Raster {
    /// An empty picture of so many pixels.
    pub(crate) fn new(width: u32, height: u32, background: Colour) -> Self {
        let [width, height] = [width, height].map(|n| samples(n) as usize);
        Self {
            width,
            height,
            colours: vec![background.0; width * height],
            nearest: vec![0.0; width * height],
            shaded: vec![false; width * height],
        }
    }

    /// Each sample of a triangle, with its barycentric coordinates.
    fn fill(&mut self, corners: [Corner; 3], mut paint: impl FnMut(&mut Self, usize, [f64; 3])) {
        let [a, b, c] = corners;
        let twice = |p: Corner, q: Corner, x: f64, y: f64| {
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
        };
        let area = twice(a, b, c[0], c[1]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let tops = [a, b, c].map(|corner| corner[1].clamp(0.0, self.height as f64));
        let top = tops.iter().fold(f64::INFINITY, |low, y| low.min(*y));
        let bottom = tops.iter().fold(0.0_f64, |high, y| high.max(*y));
        for row in top.floor() as usize..bottom.ceil() as usize {
            // Each share is linear along the row: where all three are positive is one piece
            let y = row as f64 + 0.5;
            let at = |x: f64| {
                let (of_a, of_c) = (twice(b, c, x, y) / area, twice(a, b, x, y) / area);
                [of_a, 1.0 - of_a - of_c, of_c]
            };
            let first = at(0.5);
            let slope = [b[1] - c[1], c[1] - a[1], a[1] - b[1]].map(|dy| dy / area);
            let (mut left, mut right) = (0.0_f64, self.width as f64);
            for (first, slope) in first.iter().zip(slope) {
                let zero = -first / slope;
                if slope > 0.0 {
                    left = left.max(zero.ceil());
                } else if slope < 0.0 {
                    right = right.min(zero.floor() + 1.0);
                } else if *first < 0.0 {
                    right = 0.0;
                }
            }
            for column in left as usize..right.max(0.0) as usize {
                paint(self, row * self.width + column, at(column as f64 + 0.5));
            }
        }
    }

    fn blend(&mut self, sample: usize, colour: Colour, opacity: f32) {
        for (old, new) in self.colours[sample].iter_mut().zip(colour.0) {
            *old += opacity * (new - *old);
        }
    }

    /// A triangle whose colours go over into each other, hidden by what is nearer.
    pub(crate) fn triangle(&mut self, corners: [Corner; 3], colours: [Colour; 3]) {
        self.fill(corners, |raster, sample, share| {
            let mix =
                |value: &dyn Fn(usize) -> f64| (0..3).map(|k| share[k] * value(k)).sum::<f64>();
            let near = mix(&|k| corners[k][2]) as f32;
            if near > raster.nearest[sample] {
                raster.nearest[sample] = near;
                let channel = |j: usize| mix(&|k| f64::from(colours[k].0[j])) as f32;
                raster.colours[sample] = [channel(0), channel(1), channel(2)];
            }
        });
    }

    /// A triangle of one colour that covers nothing: what is nearer hides it, it hides nothing.
    pub(crate) fn glass(&mut self, corners: [Corner; 3], colour: Colour, opacity: f32) {
        self.fill(corners, |raster, sample, share| {
            let near: f64 = (0..3).map(|k| share[k] * corners[k][2]).sum();
            if near as f32 > raster.nearest[sample] {
                raster.blend(sample, colour, opacity);
            }
        });
    }

    /// Adds to the shadow on the ground.
    pub(crate) fn shade(&mut self, corners: [Corner; 3]) {
        self.fill(corners, |raster, sample, _| raster.shaded[sample] = true);
    }

    /// Darkens the ground where it is in shadow.
    pub(crate) fn cast(&mut self, colour: Colour, opacity: f32) {
        for sample in 0..self.shaded.len() {
            if std::mem::take(&mut self.shaded[sample]) {
                self.blend(sample, colour, opacity);
            }
        }
    }

    /// A line of some width in pixels, drawn so much nearer than it is that it is seen on its own
    /// surface.
    pub(crate) fn line(&mut self, ends: [Corner; 2], width: f64, colour: Colour, opacity: f32) {
        const LIFT: f64 = 1.003;
        let [p, q] = ends;
        let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
        let length = dx.hypot(dy);
        if length == 0.0 || !length.is_finite() {
            return;
        }
        let half = 0.5 * width * f64::from(SAMPLES) / length;
        let (x, y) = (-dy * half, dx * half);
        let corner = |p: Corner, sign: f64| [p[0] + sign * x, p[1] + sign * y, p[2] * LIFT];
        let [a, b, c, d] = [corner(p, -1.), corner(q, -1.), corner(q, 1.), corner(p, 1.)];
        self.glass([a, b, c], colour, opacity);
        self.glass([a, c, d], colour, opacity);
    }

    /// A disc of some radius in pixels.
    pub(crate) fn disc(&mut self, centre: Corner, radius: f64, colour: Colour) {
        const LIFT: f64 = 1.006;
        const SIDES: u32 = 16;
        let radius = radius * f64::from(SAMPLES);
        let rim = |k: u32| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / f64::from(SIDES)).sin_cos();
            [
                centre[0] + radius * cos,
                centre[1] + radius * sin,
                centre[2] * LIFT,
            ]
        };
        let centre = [centre[0], centre[1], centre[2] * LIFT];
        for k in 0..SIDES {
            self.triangle([centre, rim(k), rim(k + 1)], [colour; 3]);
        }
    }

    /// The pixels: red, green, blue, row by row from the top, the mean of each pixel's samples.
    pub(crate) fn pixels(&self) -> Vec<u8> {
        let side = SAMPLES as usize;
        let mut pixels = Vec::with_capacity(3 * self.colours.len() / (side * side));
        for row in (0..self.height).step_by(side) {
            for column in (0..self.width).step_by(side) {
                let mut sum = [0.0_f32; 3];
                for y in row..row + side {
                    for colour in &self.colours[y * self.width + column..][..side] {
                        for (sum, value) in sum.iter_mut().zip(colour) {
                            *sum += value;
                        }
                    }
                }
                let mean = |sum: f32| 255.0 * sum / (side * side) as f32;
                pixels.extend(sum.map(|sum| mean(sum).round() as u8));
            }
        }
        pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Colour = Colour([1.0, 0.0, 0.0]);
    const BLUE: Colour = Colour([0.0, 0.0, 1.0]);
    const WHITE: Colour = Colour([1.0; 3]);

    fn corner(x: f64, y: f64, near: f64) -> Corner {
        let samples = f64::from(SAMPLES);
        [samples * x, samples * y, near]
    }

    #[test]
    fn the_nearer_hides_the_farther_in_any_order() {
        let far = [
            corner(0., 0., 0.1),
            corner(8., 0., 0.1),
            corner(0., 8., 0.1),
        ];
        let near = far.map(|[x, y, _]| [x, y, 0.2]);
        let drawn = |order: [(Colour, [Corner; 3]); 2]| {
            let mut raster = Raster::new(4, 4, WHITE);
            for (colour, corners) in order {
                raster.triangle(corners, [colour; 3]);
            }
            raster.pixels()
        };
        let expected = [255, 0, 0].repeat(16);
        assert_eq!(drawn([(BLUE, far), (RED, near)]), expected);
        assert_eq!(drawn([(RED, near), (BLUE, far)]), expected);
    }

    #[test]
    fn half_a_pixel_is_half_the_colour() {
        let mut raster = Raster::new(2, 1, WHITE);
        let [a, b] = [corner(-1., 0., 1.), corner(3., 0., 1.)];
        // All above the line from (0, 0) to (2, 1): half of the picture.
        raster.triangle(
            [corner(0., 0., 1.), corner(2., 0., 1.), corner(2., 1., 1.)],
            [RED; 3],
        );
        let red: u32 = raster
            .pixels()
            .chunks(3)
            .map(|p| 255 - u32::from(p[1]))
            .sum();
        assert!((200..=310).contains(&red), "{red} of 510 halved");
        raster.line([a, b], 10.0, BLUE, 1.0);
        assert_eq!(raster.pixels(), [0, 0, 255].repeat(2).as_slice());
        // Behind what is there nothing changes, nor does what has no area.
        raster.disc(corner(1., 0.5, 1e-9), 3.0, RED);
        raster.triangle([a, a, b], [RED; 3]);
        raster.triangle([[f64::NAN; 3], a, b], [RED; 3]);
        raster.disc(corner(1., 0.5, 1.0), 3.0, RED);
        assert_eq!(raster.pixels(), [255, 0, 0].repeat(2).as_slice());
    }
}
