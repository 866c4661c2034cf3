//! The methods a user picks from, and what is to be known of each. A new filter is one file and one line here.

use crate::auto;
use crate::baseline::{cubic, linear, nearest, push_pull};
use crate::descriptor::{Configured, Descriptor, Memory};
use crate::dictionary::fill;
use crate::sensing::{cs_gradient, cs_wavelet};
use crate::variational::{edge, ss, tv};
use crate::{Error, Filter};

/// All methods, the default first.
pub static METHODS: &[&Descriptor] = &[
    &auto::DESCRIPTOR,
    &ss::DESCRIPTOR,
    &tv::DESCRIPTOR,
    &edge::DESCRIPTOR,
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
pub struct Method(Box<dyn Configured>);

impl<S: Configured + 'static> From<S> for Method {
    fn from(settings: S) -> Self {
        Self(Box::new(settings))
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
        Self(self.0.boxed())
    }
}

impl PartialEq for Method {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name() && self.settings() == other.settings()
    }
}

impl Method {
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
        let mut method = Self((descriptor.new)());
        settings.iter().try_for_each(|(name, value)| method.set(name, value))?;
        Ok(method)
    }

    /// What is to be known of it.
    pub fn descriptor(&self) -> &'static Descriptor {
        self.0.descriptor()
    }

    /// The memory that filling takes with its settings where so much of the image is [`holes`](crate::descriptor::holes).
    pub fn memory(&self, holes: f64) -> Memory {
        self.0.memory(holes)
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
        let field = self.0.field(name).ok_or_else(missing)?;
        if setting.range.holds(value) && field.read(value) {
            return Ok(());
        }
        Err(Error::Setting {
            name: setting.name,
            value: value.into(),
            range: setting.range.to_string().into(),
        })
    }

    /// The value of a setting as the settings line has it.
    pub fn get(&self, name: &str) -> Option<String> {
        self.0.boxed().field(name).map(|field| field.show())
    }

    /// The settings on one line, `name=value` separated by spaces; equal lines mean equal results.
    pub fn settings(&self) -> String {
        let (mut own, mut plain) = (self.0.boxed(), (self.descriptor().new)());
        let mut line = Vec::new();
        for setting in self.descriptor().settings {
            let Some(shown) = own.field(setting.name).map(|field| field.show()) else { continue };
            let mut default = || plain.field(setting.name).is_some_and(|field| field.show() == shown);
            if !(setting.silent && default()) {
                line.push(format!("{}={shown}", setting.name));
            }
        }
        line.join(" ")
    }

    /// The filter itself.
    pub fn filter(&self) -> &dyn Filter {
        self.0.as_ref()
    }

    /// Whether measured pixels leave with the bits they came with.
    pub fn keeps_measured(&self) -> bool {
        let smooths = self.descriptor().settings.iter().filter(|setting| setting.smooths);
        let mut own = self.0.boxed();
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
        self.0.check()
    }

    /// Planes that a group must have; nothing if any number will do. Other groups are for the default method.
    pub fn planes(&self) -> Option<usize> {
        self.0.planes()
    }

    /// Whether weights of the samples have a meaning.
    ///
    /// # Errors
    /// The name of a setting that they cannot go with; empty if it is the method, or measured pixels stay.
    pub fn weighs(&self) -> Result<(), &'static str> {
        let smooths = self.descriptor().takes.weights && !self.keeps_measured();
        match self.0.unweighted() {
            Some(setting) => Err(setting),
            None if smooths => Ok(()),
            None => Err(""),
        }
    }
}

/// Names as a refusal lists them.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none at all".into() } else { names.join(", ") }
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
