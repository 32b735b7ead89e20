//! The ladder as a picture: the error of each revision of a model as a bar, falling to the noise
//! floor.

use crate::Light;
use crate::figure::html::percent;
use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

/// A revision of a model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rung {
    /// What it adds: an effect, or the start.
    pub name: String,
    /// Size of the effect with its interval; empty for the start.
    pub size: String,
    /// Error; NaN if it is not known.
    pub error: f64,
    /// The error in words, with its unit and its ratio to the floor.
    pub words: String,
    /// Judgement of this error.
    pub light: Light,
    /// The judgement in words; empty for the word of the light.
    pub judged: String,
    /// True for an effect that is not in the model: its error is a forecast.
    pub forecast: bool,
}

/// Errors of the revisions of a model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ladder {
    /// Title.
    pub title: String,
    /// Caption.
    pub caption: String,
    /// The noise floor; none if it is not known.
    pub floor: Option<f64>,
    /// Interval of the noise floor.
    pub floor_interval: Option<[f64; 2]>,
    /// The floor in words.
    pub floor_words: String,
    /// Revisions, oldest first.
    pub rungs: Vec<Rung>,
}

impl Ladder {
    fn most(&self) -> f64 {
        let errors = self.rungs.iter().map(|r| r.error);
        let all = errors.chain(self.floor).chain(self.floor_interval.map(|i| i[1]));
        1.02 * all.filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, f64::max)
    }
}

impl Serialize for Ladder {
    /// With positions in percent of the width, as the template uses them.
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Drawn<'a> {
            name: &'a str,
            size: &'a str,
            words: &'a str,
            light: Light,
            judged: &'a str,
            forecast: bool,
            width: String,
        }
        let most = self.most();
        let at = |v: f64| percent((v / most).clamp(0.0, 1.0));
        let rungs: Vec<Drawn<'_>> = self
            .rungs
            .iter()
            .map(|r| Drawn {
                name: &r.name,
                size: &r.size,
                words: &r.words,
                light: r.light,
                judged: &r.judged,
                forecast: r.forecast,
                width: if r.error.is_finite() { at(r.error) } else { String::new() },
            })
            .collect();
        let mut out = to.serialize_struct("Ladder", 7)?;
        out.serialize_field("title", &self.title)?;
        out.serialize_field("caption", &self.caption)?;
        out.serialize_field("floor", &self.floor.map(at))?;
        out.serialize_field("band_left", &self.floor_interval.map(|i| at(i[0])))?;
        out.serialize_field(
            "band_width",
            &self.floor_interval.map(|i| percent(((i[1] - i[0]) / most).clamp(0.0, 1.0))),
        )?;
        out.serialize_field("floor_words", &self.floor_words)?;
        out.serialize_field("rungs", &rungs)?;
        out.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_in_proportion_and_the_floor_lies_on_their_scale() {
        let rung = |error| Rung { error, ..Rung::default() };
        let ladder = Ladder {
            floor: Some(12.5),
            floor_interval: Some([10.0, 20.0]),
            rungs: vec![rung(50.0), rung(f64::NAN), rung(25.0)],
            ..Ladder::default()
        };
        let drawn = serde_json::to_value(&ladder).unwrap();
        let width = |v: &serde_json::Value| v.as_str().and_then(|s| s.trim_end_matches('%').parse::<f64>().ok());
        let (first, last) = (width(&drawn["rungs"][0]["width"]).unwrap(), width(&drawn["rungs"][2]["width"]).unwrap());
        assert!((first / last - 2.0).abs() < 1e-3 && first < 100.0);
        assert!((first / width(&drawn["floor"]).unwrap() - 4.0).abs() < 1e-2);
        assert_eq!(drawn["rungs"][1]["width"], "", "an error that is not known has no bar");
    }
}
