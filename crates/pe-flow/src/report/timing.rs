//! `report-timing.json`: what depends on the machine.

use serde_json::{Value, json};

use crate::pipeline::Design;
use crate::watch::{StageTime, Stopwatch};

/// Builds `report-timing.json`.
pub fn timing(watch: &Stopwatch, design: &Design) -> Value {
    let map = |of: &dyn Fn(&StageTime) -> Value| -> serde_json::Map<String, Value> {
        watch.stages.iter().map(|time| (time.stage.to_owned(), of(time))).collect()
    };
    json!({
        "seconds": map(&|time| json!(time.seconds)),
        "seconds_without_runs": watch.seconds_without_runs(),
        "processor_seconds": map(&|time| json!(time.processor_seconds)),
        "processor_seconds_without_runs": watch.processor_seconds_without_runs(),
        "double_ns_per_mac": design.judged.ns_per_mac.0,
        "fixed_ns_per_mac": design.judged.ns_per_mac.1,
        "peak_memory_mb": peak_memory_mb(),
    })
}

/// Peak resident memory of this process, where the system tells.
fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_ascii_whitespace().nth(1)?.parse::<f64>().ok().map(|kib| kib / 1024.0)
}
