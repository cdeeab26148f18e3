//! The terms of the directory: tags, element types, codecs, kinds, and the budget of a reader.

use std::fmt;

/// Raised when a reader of the previous version could misread the file.
pub const VERSION_MAJOR: u16 = 0;
/// Raised when sections are added that a reader of the previous version can ignore.
pub const VERSION_MINOR: u16 = 2;

/// Largest number of sections in a file.
pub const MAX_SECTIONS: usize = 1024;

/// Name of a section: 1 to 8 characters of `A-Z a-z 0-9 _ . -`, padded with zero bytes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Tag([u8; 8]);

impl Tag {
    /// The tag that these 8 bytes spell; `None` if they spell none.
    pub const fn from_bytes(bytes: [u8; 8]) -> Option<Self> {
        let mut length = 0;
        while length < 8 && bytes[length] != 0 {
            if !(bytes[length].is_ascii_alphanumeric() || matches!(bytes[length], b'_' | b'.' | b'-')) {
                return None;
            }
            length += 1;
        }
        let mut rest = length;
        while rest < 8 {
            if bytes[rest] != 0 {
                return None;
            }
            rest += 1;
        }
        if length == 0 { None } else { Some(Self(bytes)) }
    }

    /// The tag with this text; `None` if it is not a tag.
    pub const fn new(text: &str) -> Option<Self> {
        let text = text.as_bytes();
        if text.len() > 8 {
            return None;
        }
        let mut bytes = [0; 8];
        let mut i = 0;
        while i < text.len() {
            bytes[i] = text[i];
            i += 1;
        }
        Self::from_bytes(bytes)
    }

    /// The tag with this text, for constants: `const ROWS: Tag = Tag::from_static("tp.rows");` does not compile
    /// if the text is not a tag.
    ///
    /// # Panics
    /// If the text is not a tag; use [`Tag::new`] for text that is not a literal.
    #[expect(clippy::panic, reason = "in a constant it stops the compiler")]
    pub const fn from_static(text: &'static str) -> Self {
        match Self::new(text) {
            Some(tag) => tag,
            None => panic!("a tag is 1 to 8 characters of A-Z a-z 0-9 _ . -"),
        }
    }

    /// The 8 bytes of the directory.
    pub const fn to_bytes(self) -> [u8; 8] {
        self.0
    }

    /// The text without its padding.
    pub fn as_str(&self) -> &str {
        let length = self.0.iter().position(|&b| b == 0).unwrap_or(8);
        std::str::from_utf8(&self.0[..length]).unwrap_or_default()
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Debug for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tag({})", self.as_str())
    }
}

macro_rules! coded_enum {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $code:literal, $text:literal;)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$variant_doc])* $variant = $code,)* }

        impl $name {
            /// Every value, in the order of the codes.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// The value with this code in the directory.
            pub const fn from_code(code: u8) -> Option<Self> {
                match code { $($code => Some(Self::$variant),)* _ => None }
            }

            /// The code in the directory.
            pub const fn code(self) -> u8 {
                self as u8
            }

            /// Short lower-case name.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $text,)* }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.name())
            }
        }
    };
}

coded_enum! {
    /// Element type of a section's array.
    ElementType {
        /// A serialised structure, see the module `record` and `SPEC.md`; one component of one byte.
        Record = 0, "record";
        /// Unsigned 8 bits.
        U8 = 1, "u8";
        /// Signed 8 bits.
        I8 = 2, "i8";
        /// Unsigned 16 bits.
        U16 = 3, "u16";
        /// Signed 16 bits.
        I16 = 4, "i16";
        /// Unsigned 32 bits.
        U32 = 5, "u32";
        /// Signed 32 bits.
        I32 = 6, "i32";
        /// Unsigned 64 bits.
        U64 = 7, "u64";
        /// Signed 64 bits.
        I64 = 8, "i64";
        /// IEEE 754 binary16, here as [`F16Bits`].
        F16 = 9, "f16";
        /// IEEE 754 binary32.
        F32 = 10, "f32";
        /// IEEE 754 binary64.
        F64 = 11, "f64";
    }
}

impl ElementType {
    /// Size of one element in bytes.
    pub const fn size(self) -> u64 {
        match self {
            Self::Record | Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

coded_enum! {
    /// Encoding of the stored bytes of a section.
    Codec {
        /// Raw bytes, which can be read in place.
        Raw = 0, "raw";
        /// One zstd frame that states its content size.
        Zstd = 1, "zstd";
    }
}

coded_enum! {
    /// Purpose of a section. Bytes per vertex count every section that is not [`Kind::Mesh`].
    Kind {
        /// Positions, triangles, shading normals, texture coordinates.
        Mesh = 0, "mesh";
        /// The surface samples that light is gathered on.
        Samples = 1, "samples";
        /// Precomputed data of the asset's method.
        Method = 2, "method";
        /// Everything else: materials, parts, provenance, ledger.
        Metadata = 3, "metadata";
        /// Irradiance rows of the samples over an environment; bytes per vertex count them apart.
        Environment = 4, "environment";
    }
}

/// The bits of an IEEE 754 binary16 number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct F16Bits(pub u16);

/// A number that sections can hold.
pub trait Scalar: bytemuck::Pod {
    /// Its element type in the directory.
    const TYPE: ElementType;
}

/// A row of a section: a [`Scalar`] or an array of them.
pub trait Element: bytemuck::Pod {
    /// The scalar's element type in the directory.
    const TYPE: ElementType;
    /// Scalars in one row.
    const COMPONENTS: u16;
}

macro_rules! scalars {
    ($($scalar:ty => $code:ident,)*) => { $(
        impl Scalar for $scalar {
            const TYPE: ElementType = ElementType::$code;
        }
        impl Element for $scalar {
            const TYPE: ElementType = ElementType::$code;
            const COMPONENTS: u16 = 1;
        }
    )* };
}

scalars! {
    u8 => U8, i8 => I8, u16 => U16, i16 => I16, u32 => U32, i32 => I32, u64 => U64, i64 => I64,
    F16Bits => F16, f32 => F32, f64 => F64,
}

impl<T: Scalar, const N: usize> Element for [T; N]
where
    [T; N]: bytemuck::Pod,
{
    const TYPE: ElementType = T::TYPE;
    const COMPONENTS: u16 = if N <= u16::MAX as usize { N as u16 } else { 0 };
}

/// Limit on the memory that a reader may take for decoded content.
///
/// The cost of an array is its decoded length; a record costs [`Budget::RECORD_FACTOR`] times its length, because its
/// strings and lists are larger in memory than in the file. Beside it a reader takes at most 2 MiB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Limit of the cost of all sections together, in bytes.
    pub max_decoded_bytes: u64,
}

impl Budget {
    /// Largest number of bytes that a byte of a record takes while it is decoded.
    pub const RECORD_FACTOR: u64 = 12;

    /// A budget of this many bytes.
    pub const fn bytes(max_decoded_bytes: u64) -> Self {
        Self { max_decoded_bytes }
    }
}

impl Default for Budget {
    /// A budget of 2 GiB.
    fn default() -> Self {
        Self::bytes(2 << 30)
    }
}
