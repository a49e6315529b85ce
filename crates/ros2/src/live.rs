//! Rows of a log that come one by one, and the motions they make.
//!
//! A robot is never led by single rows: what has not been seen whole cannot be checked. Rows are kept
//! until a motion is complete, at a row with other jaws or at an empty line; it is then checked and
//! played like a log of its own, from rest to rest, while the rows of the next may come.

use std::io::BufRead;

use selvedge_trajectory::log::{self, Log};

use crate::error::Error;

/// Rows of one motion at most: ten minutes at 60 Hz.
const ROWS: usize = 36_000;
/// The longest line [bytes].
const LINE: u64 = 4096;
/// Lines of a log before its rows.
const HEAD: usize = 5;

/// The motions in a stream of lines: first the five lines a log begins with, then rows.
///
/// ```
/// use selvedge_ros2::live::Motions;
///
/// let text = "# selvedge-log 1\n# frame: cloth\n# tip_offset_m: 0,0,0\n# source: by hand\n\
///     t,px,py,pz,qx,qy,qz,qw,jaw\n0,0,0,0.1,0,0,0,1,0\n1,0,0.01,0.1,0,0,0,1,0\n\n\
///     2,0,0.02,0.1,0,0,0,1,0\n";
/// let mut motions = Motions::new(text.as_bytes()).unwrap();
/// assert_eq!(motions.next().unwrap().unwrap().samples.len(), 2);
/// // The second begins where the first ends.
/// let second = motions.next().unwrap().unwrap();
/// assert_eq!(second.samples[0].time, 1.0);
/// assert_eq!(second.samples.len(), 2);
/// assert!(motions.next().unwrap().is_none());
/// ```
#[derive(Debug)]
pub struct Motions<R> {
    lines: R,
    head: String,
    /// The last row of the motion before.
    last: Option<String>,
    number: usize,
    over: bool,
}

impl<R: BufRead> Motions<R> {
    /// Reads the head.
    ///
    /// # Errors
    /// [`Error::Log`] when the lines end before, or cannot be read.
    pub fn new(lines: R) -> Result<Self, Error> {
        let mut motions = Self {
            lines,
            head: String::new(),
            last: None,
            number: 0,
            over: false,
        };
        for _ in 0..HEAD {
            let line = motions.line()?;
            let line = line.ok_or_else(|| Error::Log("the input ends in its head".into()))?;
            motions.head += &line;
            motions.head.push('\n');
        }
        Ok(motions)
    }

    fn line(&mut self) -> Result<Option<String>, Error> {
        let mut line = String::new();
        let mut limited = std::io::Read::take(&mut self.lines, LINE);
        let count = limited.read_line(&mut line);
        let count = count.map_err(|e| Error::Log(format!("the input: {e}")))?;
        self.number += usize::from(count > 0);
        if count as u64 == LINE {
            return Err(Error::Log(format!("line {} is too long", self.number)));
        }
        // A row without its end may be half a row.
        if count > 0 && !line.ends_with('\n') {
            return Err(Error::Log(format!("line {} is not whole", self.number)));
        }
        Ok((count > 0).then(|| line.trim_end().to_owned()))
    }

    /// The next motion, nothing when the rows are over.
    ///
    /// # Errors
    /// [`Error::Log`] for a row that no log may have.
    #[allow(
        clippy::should_implement_trait,
        reason = "an error ends it, nothing ends it too"
    )]
    pub fn next(&mut self) -> Result<Option<Log>, Error> {
        let mut rows: Vec<String> = self.last.take().into_iter().collect();
        let carried = rows.len();
        while !self.over {
            let Some(line) = self.line()? else {
                self.over = true;
                break;
            };
            if line.is_empty() {
                if rows.len() > carried {
                    break;
                }
                continue;
            }
            let jaw = |row: &str| row.rsplit(',').next().map(str::to_owned);
            let switched = rows.last().is_some_and(|last| jaw(last) != jaw(&line));
            rows.push(line);
            if rows.len() > ROWS {
                let rows = format!("more than {ROWS} rows in one motion");
                return Err(Error::Log(rows));
            }
            if switched && rows.len() > 1 {
                break;
            }
        }
        if rows.len() <= carried {
            return Ok(None);
        }
        let text = format!("{}{}\n", self.head, rows.join("\n"));
        let name = format!("the motion that ends in line {} of the input:", self.number);
        let log = log::read(text.as_bytes(), &name).map_err(|e| Error::Log(e.to_string()))?;
        self.last = rows.pop();
        Ok(Some(log))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# selvedge-log 1\n# frame: cloth\n# tip_offset_m: 0,0,0\n# source: a\n\
                        t,px,py,pz,qx,qy,qz,qw,jaw\n";

    fn motions(rows: &str) -> Result<Vec<Vec<f64>>, Error> {
        let text = format!("{HEAD}{rows}");
        let mut motions = Motions::new(text.as_bytes())?;
        let mut all = Vec::new();
        while let Some(log) = motions.next()? {
            all.push(log.samples.iter().map(|sample| sample.time).collect());
        }
        Ok(all)
    }

    fn row(t: f64, jaw: u8) -> String {
        format!("{t},0,0,0.1,0,0,0,1,{jaw}\n")
    }

    #[test]
    fn a_motion_ends_where_the_jaws_change_and_at_an_empty_line() {
        let rows = [row(0.0, 0), row(1.0, 0), row(2.0, 1), row(3.0, 1)].concat();
        let all = motions(&(rows.clone() + "\n\n" + &row(4.0, 1))).unwrap();
        assert_eq!(all, [vec![0.0, 1.0, 2.0], vec![2.0, 3.0], vec![3.0, 4.0]]);
        assert_eq!(motions("").unwrap(), [[0.0; 0]; 0]);
    }

    #[test]
    fn half_a_row_and_rows_of_no_log_are_refused() {
        let good = row(0.0, 0);
        for (rows, word) in [
            (good.clone() + "1,0,0,0.1,0,0,0,1,0", "not whole"),
            (good.clone() + &row(0.0, 0), "ends in line 7"),
            (good.clone() + "1,0,NaN,0.1,0,0,0,1,0\n", "ends in line 7"),
            (good.clone() + &"1".repeat(5000) + "\n", "too long"),
        ] {
            let error = motions(&rows).unwrap_err().to_string();
            assert!(error.contains(word), "{word}: {error}");
        }
        assert!(Motions::new("# selvedge-log 1\n".as_bytes()).is_err());
    }
}
