//! How the triangles of a symmetric matrix are computed.

/// What is computed of a pivot, and when its multiples are subtracted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// `L D L^T`, where products of entries are computed while the reciprocal of a pivot is looked up. Where a pivot falls
    /// far below its largest value they lose as many bits as it does.
    #[default]
    Ahead,
    /// `L D L^T`, where entries are divided first.
    Plain,
    /// `L L^T` of matrices that are positive definite: entries are divided by the square root of a pivot, which varies half
    /// as many bits as the pivot.
    Root,
}

impl Scheme {
    /// All of them.
    pub const ALL: [Scheme; 3] = [Scheme::Ahead, Scheme::Plain, Scheme::Root];

    /// The one with a name.
    pub fn named(name: &str) -> Option<Scheme> {
        Scheme::ALL.into_iter().find(|scheme| scheme.name() == name)
    }

    /// The name that options and reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            Scheme::Ahead => "ahead",
            Scheme::Plain => "plain",
            Scheme::Root => "root",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            Scheme::Ahead => "Products of entries while a pivot's reciprocal is looked up: the shortest",
            Scheme::Plain => "Entries are divided by the pivot first",
            Scheme::Root => {
                "Entries are divided by the root of the pivot: the most accurate where pivots vary by orders of magnitude"
            }
        }
    }
}
