//! The methods a user picks from, and what is to be known of each. A new filter is one file, its `pub mod` and one line here.

use crate::auto;
use crate::baseline::{cubic, linear, nearest, push_pull};
use crate::choose::{AUTO, Chosen, Given};
use crate::descriptor::{Configured, Descriptor, Memory};
use crate::dictionary::fill;
use crate::network;
use crate::sensing::{cs_gradient, cs_wavelet};
use crate::variational::{edge, ss, tv};
use crate::{Error, Filter, Run};

/// All methods, the default first.
pub static METHODS: &[&Descriptor] = &[
    &auto::DESCRIPTOR,
    &ss::DESCRIPTOR,
    &tv::DESCRIPTOR,
    &edge::DESCRIPTOR,
    &network::DESCRIPTOR,
    &push_pull::DESCRIPTOR,
    &nearest::DESCRIPTOR,
    &linear::DESCRIPTOR,
    &cubic::DESCRIPTOR,
    &cs_wavelet::DESCRIPTOR,
    &cs_gradient::DESCRIPTOR,
    &fill::LEARNED,
    &fill::COSINES,
];

/// A reconstruction method with its settings: made of any `Settings` of a filter, or by name.
///
/// ```
/// use lacuna_filters::{Method, variational::ss};
///
/// let smooth = Method::from(ss::Settings { lambda: 0.5, ..ss::Settings::default() });
/// assert_eq!(smooth, Method::named("ss", &[("lambda", "0.5")])?);
/// assert_eq!(smooth.settings(), "lambda=0.5 kernel=bspline order=2 tension=0.03");
/// # Ok::<(), lacuna_filters::Error>(())
/// ```
#[derive(Debug)]
pub struct Method {
    own: Box<dyn Configured>,
    /// Settings that the samples are to choose; until then they have [`STAND_IN`].
    open: Vec<&'static str>,
}

/// The value of a setting that is still to be chosen: one that smooths.
const STAND_IN: &str = "1";

impl<S: Configured + 'static> From<S> for Method {
    fn from(settings: S) -> Self {
        Self::closed(Box::new(settings))
    }
}

impl Default for Method {
    /// What held-out samples choose.
    fn default() -> Self {
        auto::Settings.into()
    }
}

impl Clone for Method {
    fn clone(&self) -> Self {
        Self { own: self.own.boxed(), open: self.open.clone() }
    }
}

impl PartialEq for Method {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name() && self.settings() == other.settings()
    }
}

impl Method {
    fn closed(own: Box<dyn Configured>) -> Self {
        Self { own, open: Vec::new() }
    }

    /// The method of that name with these settings, `(name, value)` each, and its defaults else.
    ///
    /// # Errors
    /// [`Error::NoMethod`], [`Error::NoSetting`] and [`Error::Setting`].
    pub fn named(name: &str, settings: &[(&str, &str)]) -> Result<Self, Error> {
        let found = METHODS.iter().find(|method| method.name == name);
        let none =
            || Error::NoMethod { name: name.into(), known: listed(METHODS.iter().map(|method| method.name)) };
        Self::of(found.ok_or_else(none)?, settings)
    }

    /// The method of a descriptor with these settings, `(name, value)` each, and its defaults else.
    ///
    /// # Errors
    /// [`Error::NoSetting`] and [`Error::Setting`].
    pub fn of(descriptor: &Descriptor, settings: &[(&str, &str)]) -> Result<Self, Error> {
        let mut method = Self::closed((descriptor.new)());
        settings.iter().try_for_each(|(name, value)| method.set(name, value))?;
        Ok(method)
    }

    /// What is to be known of it.
    pub fn descriptor(&self) -> &'static Descriptor {
        self.own.descriptor()
    }

    /// The memory that filling takes with its settings where so much of the image is [`holes`](crate::estimate::holes).
    pub fn memory(&self, holes: f64) -> Memory {
        self.own.memory(holes)
    }

    /// Whether it chooses among others by their errors at held-out samples.
    pub fn chooses(&self) -> bool {
        self.name() == Self::default().name()
    }

    /// The name that tells it from the others.
    pub fn name(&self) -> &'static str {
        self.descriptor().name
    }

    /// Sets a setting by its name.
    ///
    /// # Errors
    /// [`Error::NoSetting`] and [`Error::Setting`].
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), Error> {
        let descriptor = self.descriptor();
        let known = || listed(descriptor.settings.iter().map(|setting| setting.name));
        let missing = || Error::NoSetting { method: descriptor.name, name: name.into(), known: known() };
        let setting = descriptor.setting(name).ok_or_else(missing)?;
        let field = self.own.field(name).ok_or_else(missing)?;
        let open = setting.auto && value == AUTO;
        let value = if open { STAND_IN } else { value };
        if setting.range.holds(value) && field.read(value) {
            self.open.retain(|own| *own != setting.name);
            self.open.extend(open.then_some(setting.name));
            return Ok(());
        }
        Err(Error::Setting { name: setting.name, value: value.into(), range: setting.values().into() })
    }

    /// The value of a setting as the settings line has it.
    pub fn get(&self, name: &str) -> Option<String> {
        let shown = self.own.boxed().field(name).map(|field| field.show());
        if self.open.contains(&name) { Some(AUTO.into()) } else { shown }
    }

    /// The settings on one line, `name=value` separated by spaces; equal lines mean equal results.
    pub fn settings(&self) -> String {
        let mut plain = (self.descriptor().new)();
        let mut line = Vec::new();
        for setting in self.descriptor().settings {
            let Some(shown) = self.get(setting.name) else { continue };
            let mut default = || plain.field(setting.name).is_some_and(|field| field.show() == shown);
            if !(setting.silent && default()) {
                line.push(format!("{}={shown}", setting.name));
            }
        }
        line.join(" ")
    }

    /// Whether the samples are to choose a setting.
    pub fn is_open(&self) -> bool {
        !self.open.is_empty()
    }

    /// The same with what samples are to choose chosen by these, and what that is.
    ///
    /// # Errors
    /// Those of the fills that are tried.
    pub fn settled(&self, given: &Given<'_>, run: &Run<'_>) -> Result<(Self, Vec<Chosen>), Error> {
        let (mut own, mut all) = (self.clone(), Vec::new());
        for &name in &self.open {
            if let Some((value, by)) = self.own.choose(name, given, run)? {
                // Three digits are more than the samples tell.
                let value = format!("{value:.2e}").parse().unwrap_or(value).to_string();
                own.set(name, &value)?;
                all.push(Chosen { name, value, by });
            }
        }
        Ok((own, all))
    }

    /// The same without the smoothing that samples are to choose: for those that show no noise.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn unsmoothed(&self) -> Result<Self, Error> {
        let mut own = self.clone();
        self.open.iter().try_for_each(|name| own.set(name, "0"))?;
        Ok(own)
    }

    /// The filter itself; what samples are to choose smooths.
    pub fn filter(&self) -> &dyn Filter {
        self.own.as_ref()
    }

    /// Whether measured pixels leave with the bits they came with.
    pub fn keeps_measured(&self) -> bool {
        let smooths = self.descriptor().settings.iter().filter(|setting| setting.smooths);
        let mut own = self.own.boxed();
        smooths.into_iter().all(|setting| {
            own.field(setting.name).is_none_or(|field| matches!(field.show().as_str(), "0" | "-0" | "false"))
        })
    }

    /// Whether images without a missing pixel are not left as they are.
    pub fn restores(&self) -> bool {
        self.descriptor().restores && !self.keeps_measured()
    }

    /// Whether the settings fit together.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(&self) -> Result<(), Error> {
        self.own.check()
    }

    /// Planes that a group must have; nothing if any number will do. Other groups are for the default method.
    pub fn planes(&self) -> Option<usize> {
        self.own.planes()
    }

    /// Whether weights of the samples have a meaning.
    ///
    /// # Errors
    /// The name of a setting that they cannot go with; empty if it is the method, or measured pixels stay.
    pub fn weighs(&self) -> Result<(), &'static str> {
        let smooths = self.descriptor().takes.weights && !self.keeps_measured();
        match self.own.unweighted() {
            Some(setting) => Err(setting),
            None if smooths => Ok(()),
            None => Err(""),
        }
    }
}

/// Names as a refusal lists them.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::descriptor::Range;
    use crate::{Mask, Plane, Planes, Problem, Run, Size};

    fn all() -> Vec<Method> {
        METHODS.iter().map(|found| Method::of(found, &[]).unwrap()).collect()
    }

    #[test]
    fn every_setting_is_there_shown_and_read() {
        for mut method in all() {
            let name = method.name();
            assert_eq!(METHODS.iter().filter(|other| other.name == name).count(), 1, "{name}");
            assert!(method.keeps_measured() && !method.restores(), "{name}: by default it interpolates");
            assert_eq!(method.clone(), method);
            let line = method.settings();
            assert!(!line.contains('\n'));
            for setting in method.descriptor().settings {
                let shown = method.get(setting.name).unwrap_or_else(|| panic!("{name}: {}", setting.name));
                if let Range::Dictionary = setting.range {
                    continue;
                }
                method.set(setting.name, &shown).unwrap();
                assert!(setting.silent || line.contains(&format!("{}={shown}", setting.name)), "{line}");
                assert!(
                    !setting.help.is_empty() && (setting.range.holds(&shown)),
                    "{name}: {}",
                    setting.name
                );
                for wrong in ["", "-1", "nan", "no such value"] {
                    let error = method.set(setting.name, wrong).unwrap_err().to_string();
                    assert!(error.starts_with(setting.name), "{error}");
                }
                if setting.auto {
                    method.set(setting.name, AUTO).unwrap();
                    assert!(method.is_open() && !method.keeps_measured(), "{name}: {}", setting.name);
                    assert!(method.settings().contains(&format!("{}=auto", setting.name)));
                    let size = Size::new(20, 20);
                    let mask = Arc::new(Mask::from_fn(size, |y, x| (y + x) % 2 == 0));
                    let samples =
                        Planes::new(size, vec![Plane::from_fn(size, |y, x| (y * x) as f32)]).unwrap();
                    let given = Given { mask: &mask, samples: &samples, noise: None, weights: None };
                    let (settled, chosen) = method.settled(&given, &Run::default()).unwrap();
                    assert!(!settled.is_open() && chosen[0].name == setting.name, "{name}: {chosen:?}");
                    method.set(setting.name, &shown).unwrap();
                } else {
                    assert!(method.set(setting.name, AUTO).is_err() || setting.range.holds(AUTO), "{name}");
                }
                if setting.smooths {
                    let value = if let Range::Switch = setting.range { "true" } else { "0.5" };
                    method.set(setting.name, value).unwrap();
                    assert!(!method.keeps_measured(), "{name}: {}", setting.name);
                    assert_ne!(method.settings(), line);
                    method.set(setting.name, &shown).unwrap();
                }
            }
            assert_eq!(method.settings(), line);
            assert!(matches!(method.set("no such setting", "1"), Err(Error::NoSetting { .. })));
        }
        assert!(matches!(Method::named("no such method", &[]), Err(Error::NoMethod { .. })));
        let refusal = Method::named("auto", &[("lambda", "1")]).unwrap_err().to_string();
        assert_eq!(refusal, "auto has no setting 'lambda'; it has none");
    }

    #[test]
    fn a_line_of_settings_is_what_it_was() {
        for (name, settings, line) in [
            ("pushpull", &[][..], ""),
            ("ss", &[("order", "3"), ("lambda", "1e-3")], "lambda=0.001 kernel=bspline order=3 tension=0.03"),
            ("tv", &[], "norm=isotropic epsilon=0 gap=0.01 max_iterations=2000"),
            (
                "tv",
                &[("solver", "nesta")],
                "norm=isotropic epsilon=0 gap=0.01 max_iterations=2000 solver=nesta",
            ),
            (
                "cs-wavelet",
                &[],
                "blur=20 wiener=0.0001 wavelet=db4 levels=4 boundary=periodic epsilon=0 tolerance=0.01 \
                 max_iterations=2000 solver=nesta",
            ),
            (
                "cs-gradient",
                &[],
                "anchor=border restore=false epsilon=0 tolerance=0.01 max_iterations=2000 solver=nesta",
            ),
            ("dct", &[("stride", "8")], "block=16 atoms=1024 sparsity=30 error=0 stride=8 restore=false"),
        ] {
            assert_eq!(Method::named(name, settings).unwrap().settings(), line);
        }
        let mut learned = Method::named("dictionary", &[]).unwrap();
        assert!(learned.set("dictionary", "x").is_err());
        let cosines = crate::dictionary::dct::dictionary(4, 16).unwrap();
        let dictionary = Some(Arc::new(cosines));
        learned = fill::Learned { dictionary, name: "cosines".into(), how: fill::Use::default() }.into();
        assert_eq!(learned.settings(), "dictionary=cosines sparsity=30 error=0 stride=half restore=false");
    }

    #[test]
    fn the_filter_is_that_of_the_method() {
        let size = Size::new(1, 4);
        let problem =
            |measured: &[usize]| Problem::fill(Arc::new(Mask::from_fn(size, |_, x| measured.contains(&x))));
        let samples = Plane::new(size, vec![0.0, f32::NAN, f32::NAN, 8.0]).unwrap();
        let samples = Planes::new(size, vec![samples]).unwrap();
        for (name, expected) in [("pushpull", [0.0, 2.0, 6.0, 8.0]), ("nearest", [0.0, 0.0, 8.0, 8.0])] {
            let method = Method::named(name, &[]).unwrap();
            let empty = method.filter().plan(&problem(&[]), &Run::default());
            assert_eq!(empty.err(), Some(Error::EmptyMask));
            let plan = method.filter().plan(&problem(&[0, 3]), &Run::default()).unwrap();
            let mut out = Planes::zeros(size, 1);
            plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
            assert_eq!(out.as_slice()[0].pixels(), expected, "{name}");
        }
        let none = Method::named("dictionary", &[]).unwrap();
        assert_eq!(none.filter().plan(&problem(&[0]), &Run::default()).err(), Some(Error::NoDictionary));
    }
}
