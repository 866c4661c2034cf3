//! Flags of the filters and their settings, made of the filters' descriptors.

use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser, ValueParser, ValueParserFactory};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use lacuna_filters::descriptor::{Configured, Descriptor, Range, Setting};
use lacuna_filters::dictionary::fill::{Learned, Use};
use lacuna_filters::{Error, METHODS, Method};

use super::Usage;
use crate::dictionary::Stored;

/// The filters whose flags a subcommand has.
pub trait Offer {
    /// The filters, the default first.
    fn methods() -> Vec<&'static Descriptor>;

    /// Whether a setting has a flag.
    fn has(setting: &Setting) -> bool {
        !setting.flag.is_empty()
    }
}

/// All of them.
#[derive(Clone, Copy, Debug)]
pub struct All;

impl Offer for All {
    fn methods() -> Vec<&'static Descriptor> {
        METHODS.to_vec()
    }
}

/// The name of a filter on the command line.
#[derive(Clone, Copy, Debug)]
pub struct FilterName(pub &'static Descriptor);

/// Reads the name of one of these filters.
#[derive(Clone, Debug)]
pub struct NameParser(Vec<&'static Descriptor>);

impl NameParser {
    /// Of filters that ask for no file.
    pub fn without_dictionaries() -> Self {
        Self(All::methods().into_iter().filter(|method| !method.takes.dictionary).collect())
    }
}

impl TypedValueParser for NameParser {
    type Value = FilterName;

    fn parse_ref(
        &self,
        command: &Command,
        arg: Option<&Arg>,
        value: &std::ffi::OsStr,
    ) -> Result<FilterName, clap::Error> {
        let names = PossibleValuesParser::new(self.possible_values().into_iter().flatten());
        let name = names.parse_ref(command, arg, value)?;
        let found = self.0.iter().find(|method| method.name == name);
        found
            .map(|method| FilterName(method))
            .ok_or_else(|| clap::Error::new(clap::error::ErrorKind::InvalidValue))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.0.iter().map(|method| PossibleValue::new(method.name).help(method.help))))
    }
}

impl ValueParserFactory for FilterName {
    type Parser = NameParser;

    fn value_parser() -> NameParser {
        NameParser(All::methods())
    }
}

/// The settings that were given on the command line.
#[derive(Clone, Debug)]
pub struct SettingArgs<O = All> {
    /// Flag and value of each.
    given: Vec<(&'static str, String)>,
    /// The file of a dictionary.
    dictionary: Option<PathBuf>,
    offer: PhantomData<O>,
}

/// The flags of some filters, each with the names of those that have it.
fn flags<O: Offer>() -> Vec<(&'static Setting, Vec<&'static Descriptor>)> {
    let mut flags: Vec<(&'static Setting, Vec<&'static Descriptor>)> = Vec::new();
    for method in O::methods() {
        for setting in method.settings.iter().filter(|setting| O::has(setting)) {
            match flags.iter_mut().find(|(other, _)| other.flag == setting.flag) {
                Some((_, owners)) => owners.push(method),
                None => flags.push((setting, vec![method])),
            }
        }
    }
    flags
}

/// The filters whose settings stand beside `--filter`; those of all others, the baselines, stand at the end of the help.
const LEADING: [&str; 5] = ["auto", "ss", "tv", "edge", "cnn"];

/// Whether no leading filter has a setting.
fn of_baselines(owners: &[&'static Descriptor]) -> bool {
    owners.iter().all(|owner| !LEADING.contains(&owner.name))
}

/// The flag of a setting, with what its filters say of it.
fn arg(setting: &'static Setting, owners: &[&'static Descriptor]) -> Arg {
    let names: Vec<_> = owners.iter().map(|owner| owner.name).collect();
    let text = format!("{}: {}", names.join(", "), setting.help);
    let heading = if of_baselines(owners) { "Settings of baselines" } else { "Filter" };
    let arg = Arg::new(setting.flag).long(setting.flag).help_heading(heading);
    let owner = owners[0];
    let default = || Method::of(owner, &[]).ok()?.get(setting.name);
    let parser: ValueParser = match setting.range {
        Range::Switch => return arg.help(text).action(ArgAction::SetTrue),
        Range::Dictionary => {
            return arg.help(text).value_name(setting.value).value_parser(clap::value_parser!(PathBuf));
        }
        Range::OneOf(choices) => {
            let values = choices.iter().map(|choice| PossibleValue::new(choice.name).help(choice.help));
            PossibleValuesParser::new(values).into()
        }
        _ => ValueParser::new(move |text: &str| {
            let read = Method::of(owner, &[(setting.name, text)]);
            read.map(|_| text.to_owned()).map_err(|_| format!("it must be {}", setting.values()))
        }),
    };
    let text = default().map_or_else(|| text.clone(), |default| format!("{text} [default: {default}]"));
    arg.help(text).value_name(setting.value).allow_hyphen_values(true).value_parser(parser)
}

impl<O: Offer> Args for SettingArgs<O> {
    fn augment_args(command: Command) -> Command {
        let leading = flags::<O>().into_iter().filter(|(_, owners)| !of_baselines(owners));
        command.args(leading.map(|(setting, owners)| arg(setting, &owners)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// The flags of baselines, to stand where a subcommand has them; [`SettingArgs`] reads them.
#[derive(Clone, Debug)]
pub struct BaselineArgs<O = All>(PhantomData<O>);

impl<O: Offer> Args for BaselineArgs<O> {
    fn augment_args(command: Command) -> Command {
        let others = flags::<O>().into_iter().filter(|(_, owners)| of_baselines(owners));
        command.args(others.map(|(setting, owners)| arg(setting, &owners)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<O: Offer> FromArgMatches for BaselineArgs<O> {
    fn from_arg_matches(_: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self(PhantomData))
    }

    fn update_from_arg_matches(&mut self, _: &ArgMatches) -> Result<(), clap::Error> {
        Ok(())
    }
}

impl<O: Offer> FromArgMatches for SettingArgs<O> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut read = Self { given: Vec::new(), dictionary: None, offer: PhantomData };
        read.update_from_arg_matches(matches)?;
        Ok(read)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for (setting, _) in flags::<O>() {
            if matches.value_source(setting.flag) != Some(ValueSource::CommandLine) {
                continue;
            }
            match setting.range {
                Range::Switch => self.given.push((setting.flag, "true".into())),
                Range::Dictionary => self.dictionary = matches.get_one::<PathBuf>(setting.flag).cloned(),
                _ => {
                    let text = matches.get_one::<String>(setting.flag).cloned();
                    self.given.extend(text.map(|text| (setting.flag, text)));
                }
            }
        }
        Ok(())
    }
}

impl<O: Offer> SettingArgs<O> {
    /// The method with the settings that were given. A setting of another filter is an error.
    /// What it reads takes `memory` at most, if that is bounded.
    pub fn method(&self, filter: &'static Descriptor, memory: Option<u64>) -> Result<Method, Usage> {
        let file = self.dictionary.as_ref().map(|_| "dictionary");
        let mut given = self.given.iter().map(|(flag, _)| *flag).chain(file);
        if let Some(flag) = given.find(|flag| filter.settings.iter().all(|own| own.flag != *flag)) {
            // Of several filters none is meant.
            let strange = self.of(filter).next().is_none() && self.owner().is_none();
            return Err(if strange { self.of_several() } else { Self::of_another(flag, filter.name) });
        }
        let mut method = match &self.dictionary {
            Some(path) => learned(path, memory)?,
            None if filter.takes.dictionary => {
                return Err(Usage(format!(
                    "--filter {} needs --dictionary FILE; lacuna dictionary train makes one from complete frames",
                    filter.name
                )));
            }
            None => Method::of(filter, &[]).map_err(|error| usage(filter, &error))?,
        };
        for (setting, text) in self.of(filter) {
            method.set(setting.name, text).map_err(|error| usage(filter, &error))?;
        }
        method.check().map_err(|error| usage(filter, &error))?;
        Ok(method)
    }

    /// The only filter that has all of the settings that were given, if any were and there is one.
    fn owner(&self) -> Option<&'static Descriptor> {
        let file = self.dictionary.as_ref().map(|_| "dictionary");
        let given: Vec<&str> = self.given.iter().map(|(flag, _)| *flag).chain(file).collect();
        let has = |owner: &&'static Descriptor, flag: &str| owner.settings.iter().any(|own| own.flag == flag);
        let mut owners = O::methods().into_iter().filter(|owner| given.iter().all(|flag| has(owner, flag)));
        owners.next().filter(|_| !given.is_empty() && owners.next().is_none())
    }

    /// Sets those of the settings that were given.
    pub fn apply(&self, to: &mut dyn Configured) {
        for (setting, text) in self.of(to.descriptor()) {
            if let Some(field) = to.field(setting.name) {
                field.read(text);
            }
        }
    }

    /// The settings of a filter that were given, with their texts.
    pub fn of<'a>(
        &'a self,
        filter: &'static Descriptor,
    ) -> impl Iterator<Item = (&'static Setting, &'a str)> {
        let find = |flag: &str| filter.settings.iter().find(|setting| setting.flag == flag);
        self.given.iter().filter_map(move |(flag, text)| Some((find(flag)?, text.as_str())))
    }

    /// A flag was given that is none of the filter's.
    pub fn of_another(flag: &str, filter: &str) -> Usage {
        Usage(format!("{}, but the filter is {filter}", Self::belongs(flag)))
    }

    /// Flags were given that no filter has together.
    fn of_several(&self) -> Usage {
        let file = self.dictionary.as_ref().map(|_| "dictionary");
        let given = self.given.iter().map(|(flag, _)| *flag).chain(file).map(Self::belongs);
        Usage(format!("{}: no filter has them all; give those of one", given.collect::<Vec<_>>().join(", ")))
    }

    fn belongs(flag: &str) -> String {
        let owners = flags::<O>().into_iter().find(|(setting, _)| setting.flag == flag);
        let owners = owners.into_iter().flat_map(|(_, owners)| owners);
        let owners: Vec<_> = owners.map(|owner| format!("--filter {}", owner.name)).collect();
        format!("--{flag} is a setting of {}", owners.join(" and "))
    }
}

/// The method of a dictionary; reads the file.
fn learned(path: &Path, memory: Option<u64>) -> Result<Method, Usage> {
    let stored = Stored::read(path, memory.unwrap_or(u64::MAX))
        .map_err(|error| Usage(format!("--dictionary {}: {error}", path.display())))?;
    let name = stored.name();
    Ok(Learned { name, dictionary: Some(stored.dictionary.into()), how: Use::default() }.into())
}

/// What a filter says of its settings, with the flag.
fn usage(filter: &'static Descriptor, error: &Error) -> Usage {
    match error {
        Error::Setting { name, value, range } => {
            let flag = filter.setting(name).map_or(*name, |setting| setting.flag);
            Usage(format!("--{flag} {value}: it must be {range}"))
        }
        _ => Usage(error.to_string()),
    }
}

/// A filter and its settings.
#[derive(Clone, Debug)]
pub struct FilterArgs<O = All> {
    filter: &'static Descriptor,
    settings: SettingArgs<O>,
}

impl<O: Offer> Args for FilterArgs<O> {
    fn augment_args(command: Command) -> Command {
        let methods = O::methods();
        let default = methods.first().map_or("", |method| method.name);
        let name = Arg::new("filter").long("filter").value_name("NAME").help_heading("Filter");
        let name = name
            .help("The filter that reconstructs colour; a setting of one filter alone chooses it, too")
            .value_parser(NameParser(methods));
        SettingArgs::<O>::augment_args(command.arg(name.default_value(default)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<O: Offer> FromArgMatches for FilterArgs<O> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let settings = SettingArgs::from_arg_matches(matches)?;
        let filter = matches.get_one::<FilterName>("filter");
        let filter =
            filter.ok_or_else(|| clap::Error::new(clap::error::ErrorKind::MissingRequiredArgument))?;
        let named = matches.value_source("filter") == Some(ValueSource::CommandLine);
        let implied = settings.owner().filter(|_| !named);
        Ok(Self { filter: implied.unwrap_or(filter.0), settings })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<O: Offer> FilterArgs<O> {
    /// The filter with its settings.
    pub fn method(&self, memory: Option<u64>) -> Result<Method, Usage> {
        self.settings.method(self.filter, memory)
    }

    /// The file that it reads.
    pub fn file(&self) -> Option<&PathBuf> {
        self.settings.dictionary.as_ref()
    }
}

#[cfg(test)]
mod tests;
