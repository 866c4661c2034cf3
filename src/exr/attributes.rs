//! Header attributes as the file has them: ordered, named, typed, raw.

/// The standard attributes that say where a camera looks, and what it shows where.
pub const CAMERA: [&str; 2] = ["worldToCamera", "worldToNDC"];

/// One header attribute: its bytes as they stand in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attribute {
    /// The name, without the terminating zero.
    pub name: Vec<u8>,
    /// The type's name, without the terminating zero.
    pub kind: Vec<u8>,
    /// The value, little-endian.
    pub value: Vec<u8>,
}

/// The attributes of a part, in file order, names unique.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes(Vec<Attribute>);

impl Attributes {
    /// A list whose names are known to be unique.
    pub(super) fn from_unique(list: Vec<Attribute>) -> Self {
        Self(list)
    }

    /// All attributes, in file order.
    pub fn iter(&self) -> impl Iterator<Item = &Attribute> {
        self.0.iter()
    }

    /// The attribute of that name.
    pub fn get(&self, name: &str) -> Option<&Attribute> {
        self.0.iter().find(|attribute| attribute.name == name.as_bytes())
    }

    /// The value of a `string` attribute; bytes that are not UTF-8 become the replacement character.
    pub fn text(&self, name: &str) -> Option<String> {
        let attribute = self.get(name)?;
        (attribute.kind == b"string").then(|| String::from_utf8_lossy(&attribute.value).into_owned())
    }

    /// Replaces the attribute of that name where it stands, or appends it.
    pub fn set(&mut self, name: &str, kind: &str, value: Vec<u8>) {
        let new = Attribute { name: name.into(), kind: kind.into(), value };
        match self.0.iter_mut().find(|attribute| attribute.name == new.name) {
            Some(old) => *old = new,
            None => self.0.push(new),
        }
    }

    /// Sets a `string` attribute.
    pub fn set_text(&mut self, name: &str, text: &str) {
        self.set(name, "string", text.as_bytes().to_vec());
    }

    /// Removes the attribute of that name; whether there was one.
    pub fn remove(&mut self, name: &str) -> bool {
        let before = self.0.len();
        self.0.retain(|attribute| attribute.name != name.as_bytes());
        self.0.len() != before
    }
}
