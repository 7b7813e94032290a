//! One declaration per parameter: [`params!`](crate::params) makes a struct, its defaults, and a table of what each
//! parameter is called, means and takes. The command line, the Python keywords and the documentation derive from the table.

use std::str::FromStr;

/// What is known of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParamSpec {
    /// Name as in Rust and Python (`max_depth`); the command line writes dashes for underscores.
    pub name: &'static str,
    /// Type in words: `integer`, `number`, `text`, `switch`, or the choices.
    pub kind: &'static str,
    /// Unit, or nothing.
    pub unit: &'static str,
    /// The default in words.
    pub default: &'static str,
    /// What it does, in a sentence.
    pub doc: &'static str,
}

/// Why a parameter could not be set.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParamError {
    /// There is no parameter of that name.
    #[error("unknown parameter `{0}`")]
    Unknown(String),
    /// The value does not fit.
    #[error("`{name}` takes {kind}, not `{value}`")]
    Invalid {
        /// The parameter.
        name: &'static str,
        /// What it takes.
        kind: &'static str,
        /// What was given.
        value: String,
    },
}

/// A value that can be given as text.
pub trait ParamValue: Sized {
    /// Parses the text; `None` where it does not fit.
    fn parse_param(text: &str) -> Option<Self>;
}

macro_rules! from_str_values {
    ($($t:ty),*) => {$(
        impl ParamValue for $t {
            fn parse_param(text: &str) -> Option<Self> {
                text.trim().parse().ok()
            }
        }
    )*};
}
from_str_values!(u32, u64, i32, bool);

impl ParamValue for f32 {
    fn parse_param(text: &str) -> Option<Self> {
        f32::from_str(text.trim()).ok().filter(|v| v.is_finite())
    }
}

impl ParamValue for String {
    fn parse_param(text: &str) -> Option<Self> {
        Some(text.to_owned())
    }
}

impl<T: ParamValue> ParamValue for Option<T> {
    fn parse_param(text: &str) -> Option<Self> {
        T::parse_param(text).map(Some)
    }
}

/// Declares parameters once.
///
/// ```
/// etendue_scene::params! {
///     /// How to boil an egg.
///     pub struct Egg {
///         /// How long it boils.
///         minutes: f32 = 4.0, "number", "min";
///     }
/// }
/// let mut egg = Egg::default();
/// egg.set("minutes", "5").unwrap();
/// assert_eq!(egg.minutes, 5.0);
/// assert_eq!(Egg::SPECS[0].unit, "min");
/// ```
#[macro_export]
macro_rules! params {
    ($(#[doc = $sdoc:literal])* pub struct $name:ident { $($(#[doc = $doc:literal])* $field:ident : $type:ty = $default:expr, $kind:literal, $unit:literal;)* }) => {
        $(#[doc = $sdoc])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name { $($(#[doc = $doc])* pub $field: $type),* }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default),* }
            }
        }

        impl $name {
            /// What each parameter is, in the order of the declaration.
            pub const SPECS: &'static [$crate::param::ParamSpec] = &[$($crate::param::ParamSpec {
                name: stringify!($field), kind: $kind, unit: $unit, default: stringify!($default), doc: concat!($($doc),*),
            }),*];

            /// The parameters that differ from their defaults, as `name=value`, in the order of the declaration.
            pub fn given(&self) -> String {
                let default = Self::default();
                let mut given: Vec<String> = Vec::new();
                $(if self.$field != default.$field {
                    given.push(format!(concat!(stringify!($field), "={:?}"), self.$field));
                })*
                given.join(" ")
            }

            /// Sets a parameter from text.
            ///
            /// # Errors
            /// [`ParamError`]($crate::param::ParamError) for an unknown name or a value that does not fit.
            pub fn set(&mut self, name: &str, value: &str) -> Result<(), $crate::param::ParamError> {
                match name {
                    $(stringify!($field) => match <$type as $crate::param::ParamValue>::parse_param(value) {
                        Some(v) => self.$field = v,
                        None => return Err($crate::param::ParamError::Invalid { name: stringify!($field), kind: $kind, value: value.to_owned() }),
                    },)*
                    _ => return Err($crate::param::ParamError::Unknown(name.to_owned())),
                }
                Ok(())
            }
        }
    };
}
