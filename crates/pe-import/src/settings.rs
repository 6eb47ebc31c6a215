//! Settings of a case of the SBML Test Suite.

/// What a case asks for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Time of the first row.
    pub start: f64,
    /// Time from there to the last row.
    pub duration: f64,
    /// Rows after the first.
    pub steps: u32,
    /// Columns.
    pub variables: Vec<String>,
    /// Columns that are amounts.
    pub amounts: Vec<String>,
    /// Columns that are concentrations.
    pub concentrations: Vec<String>,
    /// Tolerances: absolute, relative.
    pub tolerances: (f64, f64),
}

impl Settings {
    /// Reads `key: value` lines; the problem in words if one does not fit.
    ///
    /// # Errors
    /// A line that cannot be read, or one that is missing.
    pub fn read(text: &str) -> Result<Settings, String> {
        let mut found = Settings { duration: f64::NAN, ..Settings::default() };
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let (key, value) = line.split_once(':').ok_or(format!("line {} is no `key: value`", number + 1))?;
            let value = value.trim();
            let unread = || format!("line {}: `{}` is no number", number + 1, value.escape_debug());
            let real = || value.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(unread);
            let names =
                || value.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect();
            match key.trim() {
                "start" => found.start = real()?,
                "duration" => found.duration = real()?,
                "steps" => found.steps = value.parse().map_err(|_| unread())?,
                "variables" => found.variables = names(),
                "absolute" => found.tolerances.0 = real()?,
                "relative" => found.tolerances.1 = real()?,
                "amount" => found.amounts = names(),
                "concentration" => found.concentrations = names(),
                _ => {}
            }
        }
        if found.duration > 0.0 && found.steps > 0 {
            Ok(found)
        } else {
            Err("`duration` and `steps` must be there and positive".to_owned())
        }
    }
}
