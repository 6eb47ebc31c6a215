//! Criteria by which a design is judged.

use pe_ir::source::Diagnostic;

/// What is proven about a design.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ProofMode {
    /// Nothing: every PE saturates.
    Off,
    /// That values stay in range; PEs of which that is proven do not saturate.
    #[default]
    Ranges,
}

impl ProofMode {
    /// All of them.
    pub const ALL: [ProofMode; 2] = [ProofMode::Off, ProofMode::Ranges];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            ProofMode::Off => "off",
            ProofMode::Ranges => "ranges",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            ProofMode::Off => "Nothing: every PE saturates",
            ProofMode::Ranges => "That values stay in range; PEs of which that is proven do not saturate",
        }
    }
}

/// By what the runs of a design are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum JudgedBy {
    /// Their states at every step.
    #[default]
    Trajectories,
    /// Numbers of events, and means of states.
    Events,
}

impl JudgedBy {
    /// All of them.
    pub const ALL: [JudgedBy; 2] = [JudgedBy::Trajectories, JudgedBy::Events];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            JudgedBy::Trajectories => "trajectories",
            JudgedBy::Events => "events",
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            JudgedBy::Trajectories => "States at every step",
            JudgedBy::Events => {
                "Numbers of events in each array of states, and means: for networks whose trajectories part"
            }
        }
    }
}

/// What is proven, at what cost, and which refusals are let through.
#[derive(Clone, Debug, PartialEq)]
pub struct Criteria {
    /// What runs are compared by.
    pub by: JudgedBy,
    /// What is proven beside being measured.
    pub proof: ProofMode,
    /// Bits by which formats may become wider where that proves all ranges.
    pub widen: i32,
    /// Codes of refusals that become warnings.
    pub allow: Vec<String>,
}

impl Default for Criteria {
    fn default() -> Self {
        Criteria { by: JudgedBy::default(), proof: ProofMode::default(), widen: Criteria::WIDEN, allow: Vec::new() }
    }
}

impl Criteria {
    /// Bits by which formats may become wider unless the user says otherwise.
    pub const WIDEN: i32 = 6;

    /// Turns allowed errors into warnings.
    ///
    /// # Errors
    /// All findings, if one of them is not allowed.
    pub fn permit(&self, findings: Vec<Diagnostic>) -> Result<Vec<Diagnostic>, Vec<Diagnostic>> {
        if findings.iter().all(|finding| self.allow.iter().any(|code| code == finding.code)) {
            Ok(findings.into_iter().map(Diagnostic::into_warning).collect())
        } else {
            Err(findings)
        }
    }
}
