//! The unknowns of a regression over several records: shared ones, copies that belong to one
//! record, and a payload that some records carry.
//!
//! A payload is a rigid body fixed to a link. Its ten parameters, in the frame of the link, act
//! through the link's own columns: in the records that carry it, `p_link = p_robot + p_payload`.
//! One fit over records with and without it determines both.

use std::borrow::Cow;
use std::str::FromStr;

use nalgebra::DVector;
use pid_data::matches;
use pid_runtime::dynamics::ParamInfo;

use crate::inertia::consistent;
use crate::inertia::pseudo_inertia::{BODY, SUFFIXES};
use crate::regress::columns::LinearModel;
use crate::regress::normal::Placement;

/// Name of the payload's link among the unknowns.
pub const PAYLOAD: &str = "payload";

/// Unknowns that do not fit the model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnknownsError {
    /// A private parameter that is not a linear one of the model.
    #[error(
        "no parameter that the regression estimates fits `{name}`\n  help: it estimates {linear}"
    )]
    NoParameter {
        /// The name or pattern.
        name: String,
        /// The parameters there are.
        linear: String,
    },
    /// A payload at a link whose ten parameters are not all estimated.
    #[error(
        "a payload at `{link}`: no link of that name has its ten parameters in the regression; those that have: {links}"
    )]
    NoLink {
        /// The link.
        link: String,
        /// The links there are.
        links: String,
    },
    /// A payload that no training record carries, or that all of them carry.
    #[error(
        "a payload in `{pattern}`: {carrying} of {training} training records fit; the robot and its payload are told apart by records with and without it"
    )]
    NotTold {
        /// The pattern.
        pattern: String,
        /// Training records that carry it.
        carrying: usize,
        /// Training records.
        training: usize,
    },
}

/// A body fixed to a link in some records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Payload {
    /// The link.
    pub link: String,
    /// Names of the records that carry it; `*` stands for any characters.
    pub records: String,
}

/// A payload that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is not a payload\n  help: write LINK=RECORDS, such as `wrist_3=*_load`; `*` stands for any characters"
)]
pub struct ParsePayloadError(String);

impl FromStr for Payload {
    type Err = ParsePayloadError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=') {
            Some((link, records)) if !link.trim().is_empty() && !records.trim().is_empty() => {
                Ok(Self {
                    link: link.trim().to_owned(),
                    records: records.trim().to_owned(),
                })
            }
            _ => Err(ParsePayloadError(text.to_owned())),
        }
    }
}

/// Unknowns of a column of the model.
#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Shared(usize),
    /// One unknown per training record.
    Copies(Vec<usize>),
}

/// Columns of the link that carries the payload, where the training records tell the two apart.
fn link_columns(
    payload: &Payload,
    names: &[&str],
    training: &[String],
) -> Result<[usize; BODY], UnknownsError> {
    let carrying = training
        .iter()
        .filter(|r| matches(&payload.records, r))
        .count();
    if carrying == 0 || carrying == training.len() {
        return Err(UnknownsError::NotTold {
            pattern: payload.records.clone(),
            carrying,
            training: training.len(),
        });
    }
    let links = consistent::links(names);
    let Some((_, columns)) = links.iter().find(|(link, _)| *link == payload.link) else {
        return Err(UnknownsError::NoLink {
            link: payload.link.clone(),
            links: links
                .iter()
                .map(|(l, _)| l.as_str())
                .collect::<Vec<_>>()
                .join(", "),
        });
    };
    Ok(*columns)
}

/// The unknowns of a regression.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknowns {
    infos: Vec<ParamInfo>,
    near: DVector<f64>,
    kinds: Vec<Kind>,
    /// Columns of the link, their unknowns in the payload, and the records.
    payload: Option<([usize; BODY], [usize; BODY], String)>,
}

impl Unknowns {
    /// The linear parameters of a model near `start`; those that fit one of the names in `private`
    /// (`*` stands for any characters) once per training record.
    ///
    /// # Errors
    /// [`UnknownsError`].
    pub fn new(
        model: &LinearModel<'_>,
        start: &[f64],
        private: &[String],
        payload: Option<&Payload>,
        training: &[String],
    ) -> Result<Self, UnknownsError> {
        let params = model.model().params();
        let names: Vec<&str> = model
            .linear()
            .iter()
            .map(|&j| params[j].name.as_ref())
            .collect();
        if let Some(name) = private
            .iter()
            .find(|pattern| !names.iter().any(|n| matches(pattern, n)))
        {
            return Err(UnknownsError::NoParameter {
                name: name.clone(),
                linear: names.join(", "),
            });
        }
        let (mut infos, mut near, mut kinds) = (Vec::new(), Vec::new(), Vec::new());
        for &j in model.linear() {
            let info = &params[j];
            let own = private.iter().any(|p| matches(p, &info.name)) && training.len() > 1;
            let first = infos.len();
            if own {
                infos.extend(training.iter().map(|record| ParamInfo {
                    name: Cow::Owned(format!("{}@{record}", info.name)),
                    ..info.clone()
                }));
            } else {
                infos.push(info.clone());
            }
            near.resize(infos.len(), start[j]);
            kinds.push(match own {
                true => Kind::Copies((first..infos.len()).collect()),
                false => Kind::Shared(first),
            });
        }
        let payload = match payload {
            None => None,
            Some(payload) => {
                let columns = link_columns(payload, &names, training)?;
                let first = infos.len();
                for (suffix, &column) in SUFFIXES.iter().zip(&columns) {
                    infos.push(ParamInfo {
                        name: Cow::Owned(format!("{PAYLOAD}_{suffix}")),
                        doc: Cow::Owned(format!("body fixed to `{}`", payload.link)),
                        nominal: if *suffix == "m" { 1.0 } else { 0.0 },
                        lower: f64::NEG_INFINITY,
                        upper: f64::INFINITY,
                        ..params[model.linear()[column]].clone()
                    });
                }
                near.resize(infos.len(), 0.0);
                let body = std::array::from_fn(|k| first + k);
                Some((columns, body, payload.records.clone()))
            }
        };
        Ok(Self {
            infos,
            near: DVector::from_vec(near),
            kinds,
            payload,
        })
    }

    /// Prior knowledge of them.
    pub fn infos(&self) -> &[ParamInfo] {
        &self.infos
    }

    /// Their start values.
    pub fn near(&self) -> &DVector<f64> {
        &self.near
    }

    /// Whether they are the model's linear parameters one by one.
    pub fn plain(&self) -> bool {
        self.payload.is_none() && self.kinds.iter().all(|k| matches!(k, Kind::Shared(_)))
    }

    /// Positions of the payload's ten parameters, if there is one.
    pub fn payload(&self) -> Option<[usize; BODY]> {
        self.payload.as_ref().map(|(_, body, _)| *body)
    }

    /// Unknowns that are a parameter, or copies of it.
    pub fn of_parameter(&self, name: &str) -> Vec<usize> {
        let own = |i: &ParamInfo| match i.name.split_once('@') {
            Some((base, _)) => base == name || i.name == name,
            None => i.name == name,
        };
        (0..self.infos.len())
            .filter(|&k| own(&self.infos[k]))
            .collect()
    }

    /// The unknowns behind each column in a record: the `training`-th one, or one that is not
    /// fitted, which takes the mean of the copies.
    pub fn place(&self, record: &str, training: Option<usize>) -> Placement {
        let mut place: Placement = self
            .kinds
            .iter()
            .map(|kind| match (kind, training) {
                (Kind::Shared(i), _) => vec![(*i, 1.0)],
                (Kind::Copies(list), Some(r)) => vec![(list[r], 1.0)],
                (Kind::Copies(list), None) => mean(list),
            })
            .collect();
        if let Some((columns, body, pattern)) = &self.payload
            && matches(pattern, record)
        {
            for (&column, &unknown) in columns.iter().zip(body) {
                place[column].push((unknown, 1.0));
            }
        }
        place
    }

    /// Values of the model's columns: those of the robot alone, copies by their mean.
    pub fn robot(&self, x: &DVector<f64>) -> Vec<f64> {
        self.kinds
            .iter()
            .map(|kind| match kind {
                Kind::Shared(i) => x[*i],
                Kind::Copies(list) => mean(list).iter().map(|(i, f)| f * x[*i]).sum(),
            })
            .collect()
    }

    /// Values with the copies of a training record that was not fitted at the mean of the others'.
    pub fn left_out(&self, mut x: DVector<f64>, record: usize) -> DVector<f64> {
        for kind in &self.kinds {
            if let Kind::Copies(list) = kind {
                let others: Vec<f64> = (0..list.len())
                    .filter(|r| *r != record)
                    .map(|r| x[list[r]])
                    .collect();
                x[list[record]] = others.iter().sum::<f64>() / others.len().max(1) as f64;
            }
        }
        x
    }
}

fn mean(list: &[usize]) -> Vec<(usize, f64)> {
    let share = 1.0 / list.len() as f64;
    list.iter().map(|&i| (i, share)).collect()
}

/// Values of a model's columns in a record.
pub(crate) fn columns(place: &Placement, x: &DVector<f64>) -> Vec<f64> {
    place
        .iter()
        .map(|own| own.iter().map(|(i, f)| f * x[*i]).sum())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_models::Ur10e;
    use pid_runtime::dynamics::Dynamics;

    fn unknowns(private: &[&str], payload: Option<&str>) -> Result<Unknowns, UnknownsError> {
        let start: Vec<f64> = Ur10e.params().iter().map(|p| p.nominal).collect();
        let model = LinearModel::new(&Ur10e, &start, &[]);
        let private: Vec<String> = private.iter().map(|p| (*p).to_owned()).collect();
        let payload = payload.map(|p| p.parse().expect("a payload"));
        let records = ["a", "b", "b_load"].map(str::to_owned);
        Unknowns::new(&model, &start, &private, payload.as_ref(), &records)
    }

    #[test]
    fn copies_belong_to_their_record_and_a_payload_to_its_records() {
        let found = unknowns(&["dry_*"], Some("wrist_3=*_load")).expect("fits");
        let start: Vec<f64> = Ur10e.params().iter().map(|p| p.nominal).collect();
        let model = LinearModel::new(&Ur10e, &start, &[]);
        let columns_of = model.columns();
        assert_eq!(found.infos().len(), columns_of + 6 * 2 + BODY);
        let position = |name: &str| {
            let of = |n: &str| found.infos().iter().position(|i| i.name == n);
            of(name).expect("an unknown")
        };
        let x = DVector::from_fn(found.infos().len(), |i, _| i as f64);
        let column = |name: &str| {
            let infos = model.linear().iter().map(|&j| &Ur10e.params()[j].name);
            infos.into_iter().position(|n| n == name).expect("linear")
        };
        let value = |record: &str, training, name: &str| {
            columns(&found.place(record, training), &x)[column(name)]
        };
        let dry = |r: &str| position(&format!("dry_elbow@{r}")) as f64;
        assert_eq!(value("b", Some(1), "dry_elbow"), dry("b"));
        let mean = (dry("a") + dry("b") + dry("b_load")) / 3.0;
        assert!((value("new", None, "dry_elbow") - mean).abs() < 1e-9);
        let (own, body) = (position("wrist_3_mx") as f64, position("payload_mx") as f64);
        assert_eq!(value("b_load", Some(2), "wrist_3_mx"), own + body);
        assert_eq!(value("new_load", None, "wrist_3_mx"), own + body);
        assert_eq!(value("b", Some(1), "wrist_3_mx"), own);
        let without = found.left_out(x.clone(), 2);
        let others = 0.5 * (dry("a") + dry("b"));
        assert_eq!(without[position("dry_elbow@b_load")], others);
        assert_eq!(found.of_parameter("dry_elbow").len(), 3);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let message = |private: &[&str], payload| {
            unknowns(private, payload).expect_err("refused").to_string()
        };
        assert!(message(&["wet_*"], None).contains("`wet_*`"));
        assert!(message(&[], Some("gripper=*_load")).contains("wrist_3"));
        assert!(message(&[], Some("wrist_3=*")).contains("3 of 3"));
        assert!("wrist_3".parse::<Payload>().is_err());
    }
}
