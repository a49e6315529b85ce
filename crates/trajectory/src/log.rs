//! The command log: what the gripper was told, one row a step.
//!
//! ```text
//! # selvedge-log 1
//! # frame: cloth
//! # tip_offset_m: 0,0,-0.1034
//! # source: corner_fold.toml, case C1
//! t,px,py,pz,qx,qy,qz,qw,jaw
//! 0,0.21,0.295,0.01,0,0,-0.7071067811865475,0.7071067811865476,0
//! ```
//!
//! The pose is always `T_wg` [m, unit quaternion x y z w] in the frame of the second line, `t` is
//! in seconds and increases, `jaw` is 0 (open) or 1 (closed). Numbers are written in the shortest
//! form that reads back to the same bits. The four lines above the header are required, in this
//! order; other `#` lines are refused, for a program that moves a robot must not pass over what it
//! does not know.

use std::io::{Read, Write};

use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};

use crate::Error;

const VERSION: &str = "# selvedge-log 1";
/// Lines above the header.
const HEAD_LINES: usize = 4;
const HEADER: [&str; 9] = ["t", "px", "py", "pz", "qx", "qy", "qz", "qw", "jaw"];
/// How far the length of a quaternion in a file may be from 1.
const MAX_LENGTH_ERROR: f64 = 1e-6;
/// Up to here it is taken as it stands, as [`Pose::from_unit`] does; beyond it is normalised.
const UNIT: f64 = 1e-9;

/// The command log of one gripper.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// The frame that poses are given in, `cloth` unless the log was moved to another.
    pub frame: String,
    /// The tip of the tool in the gripper frame [m].
    pub tip_offset: DVec3,
    /// What the commands were made from, in one line for people.
    pub source: String,
    /// The commands, by increasing time.
    pub samples: Vec<Sample>,
}

impl Log {
    /// An empty log in the frame `cloth` with the tip at the origin of the gripper frame.
    pub fn new(source: impl Into<String>) -> Self {
        Self {
            frame: "cloth".into(),
            tip_offset: DVec3::ZERO,
            source: source.into(),
            samples: Vec::new(),
        }
    }
}

/// One row of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The time of the command [s].
    pub time: f64,
    /// What the gripper was told.
    pub command: Command,
}

/// Writes a log.
///
/// # Errors
/// [`Error::Log`], before anything is written, for a log that [`read`] would refuse: no sample, a
/// value that is not finite, times that do not increase, a control character in `frame` or
/// `source`. [`Error::Write`] when the writer fails.
pub fn write(writer: &mut impl Write, log: &Log) -> Result<(), Error> {
    check(log)?;
    write_checked(writer, log).map_err(Error::Write)
}

fn write_checked(writer: &mut impl Write, log: &Log) -> std::io::Result<()> {
    let tip = log.tip_offset.to_array().map(shortest).join(",");
    writeln!(writer, "{VERSION}")?;
    writeln!(writer, "# frame: {}", log.frame)?;
    writeln!(writer, "# tip_offset_m: {tip}")?;
    writeln!(writer, "# source: {}", log.source)?;
    let mut rows = csv::Writer::from_writer(writer);
    rows.write_record(HEADER)?;
    for Sample { time, command } in &log.samples {
        let (p, q) = (command.pose.position(), command.pose.rotation());
        let numbers = [*time, p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(shortest);
        let jaw = if command.jaw.is_closed() { "1" } else { "0" };
        rows.write_record(numbers.iter().map(String::as_str).chain([jaw]))?;
    }
    rows.flush()
}

/// The shorter of `0.0001` and `1e-4`; both read back to the same bits.
fn shortest(x: f64) -> String {
    let (plain, scientific) = (x.to_string(), format!("{x:e}"));
    if scientific.len() < plain.len() {
        scientific
    } else {
        plain
    }
}

fn check(log: &Log) -> Result<(), Error> {
    let whole = "log to be written";
    for (field, text) in [("frame", &log.frame), ("source", &log.source)] {
        if text.chars().any(char::is_control) {
            let bound = "free of control characters";
            return Err(refused(whole, field, format!("{text:?}"), bound));
        }
    }
    if log.frame.is_empty() {
        return Err(refused(whole, "frame", "empty", "a name"));
    }
    if !log.tip_offset.is_finite() {
        let value = log.tip_offset.to_string();
        return Err(refused(whole, "tip_offset", value, "finite"));
    }
    if log.samples.is_empty() {
        return Err(refused(whole, "samples", "empty", "one row at least"));
    }
    let mut previous = f64::NEG_INFINITY;
    for (k, Sample { time, command }) in log.samples.iter().enumerate() {
        let place = || format!("sample {k} to be written");
        if !(*time > previous && time.is_finite()) {
            let value = format!("{time} after {previous}");
            let bound = "finite and larger than the one before";
            return Err(refused(place(), "t", value, bound));
        }
        previous = *time;
        let (p, q) = (command.pose.position(), command.pose.rotation());
        if !(p.is_finite() && q.is_finite()) {
            return Err(refused(place(), "pose", format!("{p} {q}"), "finite"));
        }
    }
    Ok(())
}

fn refused(
    place: impl Into<String>,
    field: &'static str,
    value: impl Into<String>,
    bound: &'static str,
) -> Error {
    Error::Log {
        place: place.into(),
        field,
        value: value.into(),
        bound,
    }
}

/// Reads a log; `name` stands for it in errors.
///
/// A quaternion whose length is 1 to 1e-9 is taken as it stands, so that what was written comes
/// back to the bit; one that is off by up to 1e-6 is normalised, one further off refused. Lines may
/// end in `\r\n`.
///
/// # Errors
/// [`Error::Read`] when the reader fails; [`Error::Log`] naming line, field, value and bound for an
/// unknown version, a missing or unknown line, a wrong header, a row without nine columns, a last
/// line without its end, what is no finite number, a quaternion that is not of unit length, a jaw
/// that is not 0 or 1, times that do not increase, and a log without rows.
pub fn read(mut reader: impl Read, name: &str) -> Result<Log, Error> {
    let fail = |source| Error::Read {
        name: name.to_owned(),
        source,
    };
    let mut text = String::new();
    reader.read_to_string(&mut text).map_err(fail)?;
    let file = File { name };

    let (mut log, table) = file.head(&text)?;
    if !table.ends_with('\n') {
        let (line, last) = text.lines().enumerate().last().unwrap_or((0, ""));
        let bound = "a whole line with its end: the log was cut";
        return Err(file.refuse(line + 1, "last line", quoted(last), bound));
    }
    let mut rows = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .from_reader(table.as_bytes())
        .into_records();
    let mut next = || -> Result<_, Error> {
        let Some(row) = rows.next() else {
            return Ok(None);
        };
        let row = row.map_err(|error| fail(error.into()))?;
        let line = HEAD_LINES + row.position().map_or(0, |at| at.line() as usize);
        Ok(Some((line, row)))
    };

    let (line, header) = next()?.unwrap_or((HEAD_LINES + 1, csv::StringRecord::new()));
    if header != HEADER[..] {
        let found = quoted(&header.iter().collect::<Vec<_>>().join(","));
        let bound = "`t,px,py,pz,qx,qy,qz,qw,jaw`";
        return Err(file.refuse(line, "header", found, bound));
    }
    while let Some((line, row)) = next()? {
        let sample = file.sample(line, &row)?;
        if let Some(previous) = log.samples.last().filter(|last| sample.time <= last.time) {
            let value = format!("{} after {}", sample.time, previous.time);
            return Err(file.refuse(line, "t", value, "larger than the one before"));
        }
        log.samples.push(sample);
    }
    if log.samples.is_empty() {
        return Err(file.refuse(line + 1, "table", "empty", "one row at least"));
    }
    Ok(log)
}

/// The file that is read, as errors name it.
struct File<'a> {
    name: &'a str,
}

impl File<'_> {
    fn refuse(
        &self,
        line: usize,
        field: &'static str,
        value: impl Into<String>,
        bound: &'static str,
    ) -> Error {
        refused(format!("{} line {line}", self.name), field, value, bound)
    }

    /// The lines above the table as a log without samples, and the rest of the text.
    fn head<'t>(&self, text: &'t str) -> Result<(Log, &'t str), Error> {
        let mut rest = text;
        let heads: [&str; HEAD_LINES] = std::array::from_fn(|_| {
            let (line, after) = rest.split_once('\n').unwrap_or((rest, ""));
            rest = after;
            line.strip_suffix('\r').unwrap_or(line)
        });
        if heads[0] != VERSION {
            return Err(self.refuse(1, "version", quoted(heads[0]), "`# selvedge-log 1`"));
        }
        let value = |k: usize, field, key: &str, bound| match heads[k].strip_prefix(key) {
            Some(value) => Ok(value.strip_prefix(' ').unwrap_or(value)),
            None => Err(self.refuse(k + 1, field, quoted(heads[k]), bound)),
        };
        let frame = value(1, "frame", "# frame:", "`# frame: NAME`")?;
        if frame.is_empty() {
            return Err(self.refuse(2, "frame", "empty", "a name"));
        }
        let tip = value(
            2,
            "tip_offset_m",
            "# tip_offset_m:",
            "`# tip_offset_m: X,Y,Z`",
        )?;
        let numbers: Option<Vec<f64>> = tip.split(',').map(number).collect();
        let Some(&[x, y, z]) = numbers.as_deref() else {
            let bound = "three finite numbers with commas between";
            return Err(self.refuse(3, "tip_offset_m", quoted(tip), bound));
        };
        let source = value(3, "source", "# source:", "`# source: TEXT`")?;
        let log = Log {
            frame: frame.to_owned(),
            tip_offset: DVec3::new(x, y, z),
            source: source.to_owned(),
            samples: Vec::new(),
        };
        Ok((log, rest))
    }

    /// One row of the table.
    fn sample(&self, line: usize, row: &csv::StringRecord) -> Result<Sample, Error> {
        if row.len() != HEADER.len() {
            return Err(self.refuse(line, "number of columns", row.len().to_string(), "9"));
        }
        let mut x = [0.0; 8];
        for (k, x) in x.iter_mut().enumerate() {
            *x = number(&row[k])
                .ok_or_else(|| self.refuse(line, HEADER[k], quoted(&row[k]), "a finite number"))?;
        }
        let [time, px, py, pz, qx, qy, qz, qw] = x;
        let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
        let pose = pose(DVec3::new(px, py, pz), rotation).ok_or_else(|| {
            let value = format!("of length {}", rotation.length());
            self.refuse(line, "quaternion", value, "of length 1 to 1e-6")
        })?;
        let jaw = match &row[8] {
            "0" => Jaw::Open,
            "1" => Jaw::Closed,
            other => return Err(self.refuse(line, "jaw", quoted(other), "0 or 1")),
        };
        let command = Command { pose, jaw };
        Ok(Sample { time, command })
    }
}

/// A finite number, without spaces around it.
fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|x: &f64| x.is_finite())
}

/// The pose of a row, unless the length of its quaternion is too far from 1.
fn pose(position: DVec3, rotation: DQuat) -> Option<Pose> {
    let off = (rotation.length() - 1.0).abs();
    if off <= UNIT {
        Some(Pose::from_unit(position, rotation))
    } else if off <= MAX_LENGTH_ERROR {
        Pose::new(position, rotation).ok()
    } else {
        None
    }
}

/// The text in backquotes, cut to what fits into a message.
fn quoted(text: &str) -> String {
    const MAX: usize = 60;
    match text.char_indices().nth(MAX) {
        Some((end, _)) => format!("`{}...`", &text[..end]),
        None => format!("`{text}`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "# selvedge-log 1\n# frame: cloth\n# tip_offset_m: 0,0,-0.1\n# source: a test\n";
    const COLUMNS: &str = "t,px,py,pz,qx,qy,qz,qw,jaw\n";

    fn log() -> Log {
        let sample = |time, x, angle, jaw| {
            let q = DQuat::from_rotation_z(angle);
            let pose = Pose::new(DVec3::new(x, -0.0, 1e-7), q).unwrap();
            let command = Command { pose, jaw };
            Sample { time, command }
        };
        Log {
            tip_offset: DVec3::new(0.0, 0.0, -0.1),
            samples: vec![
                sample(0.0, 0.5, 0.0, Jaw::Open),
                sample(1.0 / 60.0, 1.0 / 3.0, 1e-9, Jaw::Closed),
                sample(0.1, f64::MIN_POSITIVE / 3.0, -2.2, Jaw::Closed),
            ],
            ..Log::new("a test")
        }
    }

    fn written(log: &Log) -> String {
        let mut bytes = Vec::new();
        write(&mut bytes, log).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    fn error(text: &str) -> String {
        read(text.as_bytes(), "run.csv").unwrap_err().to_string()
    }

    #[test]
    fn the_text_is_as_documented() {
        let one = Log {
            samples: log().samples[..1].to_vec(),
            ..log()
        };
        assert_eq!(
            written(&one),
            format!("{HEAD}{COLUMNS}0,0.5,-0,1e-7,0,0,0,1,0\n")
        );
    }

    #[test]
    fn what_is_written_reads_back_to_the_bit() {
        let back = read(written(&log()).as_bytes(), "run.csv").unwrap();
        assert_eq!(back, log());
        assert!(back.samples[0].command.pose.position().y.is_sign_negative());
        // Also with the line ends of other systems and with an empty source.
        let text = written(&log()).replace('\n', "\r\n");
        assert_eq!(read(text.as_bytes(), "run.csv").unwrap(), log());
        let quiet = Log {
            source: String::new(),
            ..log()
        };
        let text = written(&quiet).replace("source: \n", "source:\n");
        assert_eq!(read(text.as_bytes(), "run.csv").unwrap(), quiet);
    }

    #[test]
    fn quaternions_of_few_digits_are_normalised() {
        let row = |w: &str| format!("{HEAD}{COLUMNS}0,0,0,0,0,0,0.7071068,{w},1\n");
        let log = read(row("0.7071068").as_bytes(), "run.csv").unwrap();
        let q = log.samples[0].command.pose.rotation();
        assert!((q.length() - 1.0).abs() < 1e-15);
        let message = error(&row("0.70711"));
        assert!(
            message.starts_with("run.csv line 6: quaternion is of length 1.00000"),
            "{message}"
        );
        assert!(
            message.ends_with("must be of length 1 to 1e-6"),
            "{message}"
        );
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let good = written(&log());
        let rows = |rows: &str| format!("{HEAD}{COLUMNS}{rows}");
        let long = "x".repeat(100);
        for (text, message) in [
            (
                "".to_owned(),
                "line 1: version is ``, must be `# selvedge-log 1`",
            ),
            (
                good.replace("log 1", "log 2"),
                "line 1: version is `# selvedge-log 2`, must be `# selvedge-log 1`",
            ),
            (
                good.replace("# frame: cloth\n", ""),
                "line 2: frame is `# tip_offset_m: 0,0,-0.1`, must be `# frame: NAME`",
            ),
            (
                good.replace("cloth", ""),
                "line 2: frame is empty, must be a name",
            ),
            (
                good.replace("-0.1\n", "\n"),
                "line 3: tip_offset_m is `0,0,`, must be three finite numbers with commas between",
            ),
            (
                good.replace("0,0,-0.1\n", "0,0\n"),
                "line 3: tip_offset_m is `0,0`, must be three finite numbers with commas between",
            ),
            (
                good.replace("# source", "# base: 1,2,3\n# source"),
                "line 4: source is `# base: 1,2,3`, must be `# source: TEXT`",
            ),
            (
                good.replace("t,px", "# note\nt,px"),
                "line 5: header is `# note`, must be `t,px,py,pz,qx,qy,qz,qw,jaw`",
            ),
            (
                good.replace("t,px", "time,px"),
                "line 5: header is `time,px,py,pz,qx,qy,qz,qw,jaw`, must be \
                 `t,px,py,pz,qx,qy,qz,qw,jaw`",
            ),
            (
                HEAD.to_owned(),
                "line 4: last line is `# source: a test`, must be a whole line with its end: the \
                 log was cut",
            ),
            (rows(""), "line 6: table is empty, must be one row at least"),
            (
                rows("0,0,0,0,0,0,0,1,0"),
                "line 6: last line is `0,0,0,0,0,0,0,1,0`, must be a whole line with its end: the \
                 log was cut",
            ),
            (
                rows("0,0,0,0,0,0,0,1\n"),
                "line 6: number of columns is 8, must be 9",
            ),
            (
                rows("0,0,0,0,0,0,0,1,0,0\n"),
                "line 6: number of columns is 10, must be 9",
            ),
            (
                rows("0,0,0,0,0,0,0,1,0\n# stop\n"),
                "line 7: number of columns is 1, must be 9",
            ),
            (
                rows("0,0,x,0,0,0,0,1,0\n"),
                "line 6: py is `x`, must be a finite number",
            ),
            (
                rows("0,0, 1,0,0,0,0,1,0\n"),
                "line 6: py is ` 1`, must be a finite number",
            ),
            (
                rows("0,0,0,0,NaN,0,0,1,0\n"),
                "line 6: qx is `NaN`, must be a finite number",
            ),
            (
                rows("inf,0,0,0,0,0,0,1,0\n"),
                "line 6: t is `inf`, must be a finite number",
            ),
            (
                rows("0,0,0,1e999,0,0,0,1,0\n"),
                "line 6: pz is `1e999`, must be a finite number",
            ),
            (
                rows("0,0,0,0,0,0,0,0,0\n"),
                "line 6: quaternion is of length 0, must be of length 1 to 1e-6",
            ),
            (
                rows("0,0,0,0,0,0,0,1.5,0\n"),
                "line 6: quaternion is of length 1.5, must be of length 1 to 1e-6",
            ),
            (
                rows("0,0,0,0,1e300,1e300,0,0,0\n"),
                "line 6: quaternion is of length inf, must be of length 1 to 1e-6",
            ),
            (
                rows("0,0,0,0,0,0,0,1,2\n"),
                "line 6: jaw is `2`, must be 0 or 1",
            ),
            (
                rows("0,0,0,0,0,0,0,1,0\n0,0,0,0,0,0,0,1,0\n"),
                "line 7: t is 0 after 0, must be larger than the one before",
            ),
            (
                rows(&format!("{long},0,0,0,0,0,0,1,0\n")),
                &format!("line 6: t is `{}...`, must be a finite number", &long[..60]),
            ),
        ] {
            assert_eq!(error(&text), format!("run.csv {message}"));
        }
        let error = read(&b"\xff\xfe"[..], "run.csv").unwrap_err();
        assert_eq!(error.to_string(), "run.csv cannot be read");
        // Cut anywhere, a log is refused.
        for end in 0..good.len() {
            read(&good.as_bytes()[..end], "run.csv")
                .map(|cut| assert!(good[..end].ends_with('\n') && cut.samples.len() < 3))
                .ok();
        }
    }

    #[test]
    fn what_would_be_refused_is_not_written() {
        let broken = |change: fn(&mut Log)| {
            let mut log = log();
            change(&mut log);
            let mut bytes = Vec::new();
            let error = write(&mut bytes, &log).unwrap_err();
            assert!(bytes.is_empty());
            error.to_string()
        };
        for (error, message) in [
            (
                broken(|log| log.samples.clear()),
                "log to be written: samples is empty, must be one row at least",
            ),
            (
                broken(|log| log.source = "two\nlines".into()),
                "log to be written: source is \"two\\nlines\", must be free of control characters",
            ),
            (
                broken(|log| log.frame.clear()),
                "log to be written: frame is empty, must be a name",
            ),
            (
                broken(|log| log.tip_offset.x = f64::NAN),
                "log to be written: tip_offset is [NaN, 0, -0.1], must be finite",
            ),
            (
                broken(|log| log.samples[1].time = 0.0),
                "sample 1 to be written: t is 0 after 0, must be finite and larger than the one \
                 before",
            ),
            (
                broken(|log| log.samples[0].command.pose = Pose::from_translation(DVec3::INFINITY)),
                "sample 0 to be written: pose is [inf, inf, inf] [0, 0, 0, 1], must be finite",
            ),
        ] {
            assert_eq!(error, message);
        }
    }
}
