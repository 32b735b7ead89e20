//! The grade of a held-out error by its ratio to the noise floor: one function, its limits and its
//! words. Every text, page, JSON, export and the table in the book take the grade from here.

use aloft_regressor::limits::{at_floor, times_floor};
use aloft_regressor::{FAIR_TIMES_FLOOR, FLOOR_KNOWN_WITHIN, POOR_TIMES_FLOOR};
use serde::{Deserialize, Serialize};

/// Grade of an error, the better first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// The floor is not known, or so roughly that the error could as well be poor.
    NotJudged,
    /// Below the interval of the floor.
    BelowFloor,
    /// Within the interval of the floor.
    AtFloor,
    /// Above the interval, or the floor has none, and below [`Limits::fair`] times the floor.
    Good,
    /// Above the interval, and below [`Limits::poor`] times the floor.
    Fair,
    /// [`Limits::poor`] times the floor or more.
    Poor,
}

/// Ratios of error to floor at which the grade changes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limits {
    /// From here on an error is no longer good.
    pub fair: f64,
    /// From here on it is poor.
    pub poor: f64,
    /// Upper end of the floor's interval over the floor up to which an error within the interval is
    /// judged.
    pub known: f64,
}

/// Why an error is graded worse than its ratio alone would be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reserve {
    /// The gate of the identification did not pass: the tables, not the motion, give the body.
    FromTables,
    /// The recordings contradict themselves or what is stated: that is corrected first.
    CorrectFirst,
}

/// Colour of a grade, the same on every surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// No colour: nothing is judged.
    Unknown,
    /// Green.
    Good,
    /// Yellow.
    Fair,
    /// Red.
    Poor,
}

/// A grade, and why it is worse than the ratio alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Graded {
    /// The grade.
    pub grade: Grade,
    /// Why it is worse than the ratio alone; none if it is not.
    pub because: Option<Reserve>,
}

impl Grade {
    /// The limits.
    pub const LIMITS: Limits = Limits { fair: FAIR_TIMES_FLOOR, poor: POOR_TIMES_FLOOR, known: FLOOR_KNOWN_WITHIN };
    /// All grades, the better first.
    pub const ALL: [Self; 6] = [Self::NotJudged, Self::BelowFloor, Self::AtFloor, Self::Good, Self::Fair, Self::Poor];

    /// Grade of an error (N), from the floor (N) and its 95 % interval.
    pub fn of(error: f64, floor: Option<f64>, ci95: Option<[f64; 2]>) -> Self {
        let Some(times) = floor.and_then(|f| times_floor(error, f, ci95)) else { return Self::NotJudged };
        let within = floor.and_then(|f| at_floor(error, f, ci95)) == Some(true);
        match times {
            t if t >= Self::LIMITS.poor => Self::Poor,
            _ if within && ci95.is_some_and(|[least, _]| error < least) => Self::BelowFloor,
            _ if within => Self::AtFloor,
            t if t < Self::LIMITS.fair => Self::Good,
            _ => Self::Fair,
        }
    }

    /// The word that every surface shows.
    pub fn word(self) -> &'static str {
        match self {
            Self::NotJudged => "not judged",
            Self::BelowFloor => "below the floor",
            Self::AtFloor => "at the floor",
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
        }
    }

    /// The colour that goes with the word.
    pub fn signal(self) -> Signal {
        match self {
            Self::NotJudged => Signal::Unknown,
            Self::BelowFloor | Self::AtFloor | Self::Good => Signal::Good,
            Self::Fair => Signal::Fair,
            Self::Poor => Signal::Poor,
        }
    }

    /// When an error has this grade, for the book.
    pub fn meaning(self) -> String {
        let Limits { fair, poor, known } = Self::LIMITS;
        match self {
            Self::NotJudged => format!(
                "the floor is not known; or the upper end of its interval is above {known} times the floor, and the error is within the interval"
            ),
            Self::BelowFloor => "the error is below the 95 % interval of the floor".to_owned(),
            Self::AtFloor => "the error is within the 95 % interval of the floor".to_owned(),
            Self::Good => {
                format!("the error is above the interval, or the floor has none, and below {fair} times the floor")
            }
            Self::Fair => format!("the error is above the interval, and from {fair} to below {poor} times the floor"),
            Self::Poor => format!("the error is {poor} times the floor or more"),
        }
    }

    /// What to do about it, for the book.
    pub fn advice(self) -> &'static str {
        match self {
            Self::NotJudged => "record more flights, so that the floor is known",
            Self::BelowFloor => {
                "as *at the floor*; a perfect model falls this low in 1 of 40 sets of recordings: see whether recordings repeat each other"
            }
            Self::AtFloor => "use the model: a perfect one could err as much on these recordings",
            Self::Good => "a small effect may be missing: run `discover`",
            Self::Fair => "something may be missing: run `discover`",
            Self::Poor => "something is missing from the model: run `discover`",
        }
    }

    /// This grade for the reason of the ratio alone.
    pub fn plain(self) -> Graded {
        Graded { grade: self, because: None }
    }
}

impl Reserve {
    /// All reasons.
    pub const ALL: [Self; 2] = [Self::FromTables, Self::CorrectFirst];

    /// The words that follow the grade after a colon.
    pub fn words(self) -> &'static str {
        match self {
            Self::FromTables => "from tables",
            Self::CorrectFirst => "correct first",
        }
    }

    /// What it means, for the book.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::FromTables => {
                "the gate of the identification did not pass, so that the body is that of the tables: at best *fair*"
            }
            Self::CorrectFirst => {
                "something else is to be corrected first (the line `first` of `aloft run` says what): at best *fair*, and *poor* where every error rests on it, as on a wrong mass"
            }
        }
    }
}

impl Graded {
    /// The best grade of a body whose identification did not pass its gate.
    pub const FROM_TABLES: Self = Self { grade: Grade::Fair, because: Some(Reserve::FromTables) };
    /// The best grade where something is to be corrected before effects are looked for.
    pub const CORRECT_FIRST: Self = Self { grade: Grade::Fair, because: Some(Reserve::CorrectFirst) };
    /// The grade of errors that all rest on something known to be wrong.
    pub const VOID: Self = Self { grade: Grade::Poor, because: Some(Reserve::CorrectFirst) };

    /// This grade, or `best` where it would be better. An error that is not judged stays so, unless
    /// it cannot be anything but poor.
    #[must_use]
    pub fn at_best(self, best: Self) -> Self {
        let open = self.grade == Grade::NotJudged && best.grade != Grade::Poor;
        if self.grade < best.grade && !open { best } else { self }
    }

    /// The grade in words, as every surface prints it: `at the floor`, `fair: from tables`.
    pub fn words(self) -> String {
        let because = self.because.map_or(String::new(), |r| format!(": {}", r.words()));
        format!("{}{because}", self.grade.word())
    }

    /// Its colour.
    pub fn signal(self) -> Signal {
        self.grade.signal()
    }

    /// True if a perfect model could have left the error, and nothing speaks against it.
    pub fn is_at_floor(self) -> bool {
        matches!(self.grade, Grade::BelowFloor | Grade::AtFloor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_graded_by_its_floor_and_never_by_newtons() {
        let (sharp, wide, vague) = (Some([0.9, 1.1]), Some([0.4, 2.9]), Some([0.2, 5.0]));
        for (error, floor, ci95, grade) in [
            (1.0, None, None, Grade::NotJudged),
            (1.0, Some(0.0), None, Grade::NotJudged),
            (f64::NAN, Some(1.0), sharp, Grade::NotJudged),
            (4.9, Some(1.0), vague, Grade::NotJudged),
            (5.1, Some(1.0), vague, Grade::Poor),
            (0.8, Some(1.0), sharp, Grade::BelowFloor),
            (0.9, Some(1.0), sharp, Grade::AtFloor),
            (1.1, Some(1.0), sharp, Grade::AtFloor),
            (2.8, Some(1.0), wide, Grade::AtFloor),
            (1.2, Some(1.0), sharp, Grade::Good),
            (1.2, Some(1.0), None, Grade::Good),
            (0.2, Some(1.0), None, Grade::Good),
            (1.5, Some(1.0), sharp, Grade::Fair),
            (1.5, Some(1.0), None, Grade::Fair),
            (2.95, Some(1.0), wide, Grade::Fair),
            (3.0, Some(1.0), sharp, Grade::Poor),
            (116.0, Some(1.0), None, Grade::Poor),
        ] {
            assert_eq!(Grade::of(error, floor, ci95), grade, "{error} on {floor:?} {ci95:?}");
            // the unit does not matter
            let scaled = |x: f64| 1e3 * x;
            assert_eq!(Grade::of(scaled(error), floor.map(scaled), ci95.map(|c| c.map(scaled))), grade);
        }
    }

    #[test]
    fn a_reserve_makes_no_grade_better_and_says_why() {
        for grade in Grade::ALL {
            let plain = grade.plain();
            for made in [Graded::FROM_TABLES, Graded::CORRECT_FIRST, Graded::VOID].map(|best| plain.at_best(best)) {
                assert!(made.grade >= grade && made.signal() >= plain.signal());
                assert_eq!(made.because.is_some(), made.grade > grade, "{grade:?}: {made:?}");
            }
        }
        let words = |g: Grade, best: Graded| g.plain().at_best(best).words();
        assert_eq!(words(Grade::AtFloor, Graded::FROM_TABLES), "fair: from tables");
        assert_eq!(words(Grade::Fair, Graded::FROM_TABLES), "fair");
        assert_eq!(words(Grade::AtFloor, Graded::VOID), "poor: correct first");
        assert_eq!(words(Grade::NotJudged, Graded::VOID), "poor: correct first");
        assert_eq!(words(Grade::NotJudged, Graded::FROM_TABLES), "not judged");
    }
}
