//! The network of PEs with the load of each: as nodes and lines, or as a matrix where there are too many lines.

use std::collections::BTreeMap;

use pe_ir::index::{List, PeId};
use pe_ir::program::{LinkSource, Program};

use crate::canvas::{Anchor, Canvas, picture};
use crate::chart::title;
use crate::layout::{Place, close_order, places};
use crate::style::{GRID, INK, LABEL, MARGIN, PAPER, SMALL, SOFT, TITLE, Tone, counted, shaded, text_width, wrapped};

/// Width of the picture, and the largest extent of the network in it.
const WIDTH: f64 = 900.0;
const EXTENT: f64 = WIDTH - 2.0 * MARGIN;

/// PEs from which on networks that are not nearly trees become matrices, and connections per PE from which on all do.
const LARGE: usize = 100;
const DENSE: usize = 4;

/// Width of the loads beside a matrix.
const BARS: f64 = 110.0;

/// A network as it is drawn.
pub struct Network {
    /// Share of the cycles in which each PE issues a product.
    pub loads: List<PeId, f64>,
    /// Words per step from a PE to another.
    pub words: BTreeMap<(PeId, PeId), u64>,
    /// PEs that read an external input.
    pub reads_input: List<PeId, bool>,
    /// PEs that compute an output.
    pub gives_output: List<PeId, bool>,
}

impl Network {
    /// The network of a program.
    pub fn of(program: &Program) -> Network {
        let pes = program.pes.len();
        let mut words = BTreeMap::new();
        let mut reads_input = List::filled(false, pes);
        for (to, pe) in program.pes.numbered() {
            for (port, _) in pe.words.iter().filter_map(|word| word.receive) {
                match pe.ports[port] {
                    // Words that a PE sends to itself cross no link between PEs.
                    LinkSource::Pe(from) if from == to => {}
                    LinkSource::Pe(from) => {
                        *words.entry((from, to)).or_insert(0) += 1;
                    }
                    LinkSource::Input(_) => reads_input[to] = true,
                }
            }
        }
        let mut gives_output = List::filled(false, pes);
        program.outputs.iter().for_each(|output| gives_output[output.pe] = true);
        Network {
            loads: program.pes.iter().map(|pe| load(pe, program.period)).collect(),
            words,
            reads_input,
            gives_output,
        }
    }

    /// Places of the PEs in the plane, in units of about the length of a connection.
    pub fn places(&self) -> Vec<Place> {
        places(self.loads.len(), &self.edges())
    }

    /// Pairs of PEs that are connected, in either direction.
    pub fn connections(&self) -> usize {
        self.words.keys().filter(|(from, to)| from < to || !self.words.contains_key(&(*to, *from))).count()
    }

    fn edges(&self) -> Vec<(usize, usize)> {
        self.words.keys().map(|(from, to)| (from.index(), to.index())).collect()
    }

    /// The PE with most products, the first of them.
    fn busiest(&self) -> PeId {
        self.loads.ids().fold(PeId::new(0), |best, pe| if self.loads[pe] > self.loads[best] { pe } else { best })
    }
}

/// Share of the cycles in which a PE issues a product.
pub(crate) fn load(pe: &pe_ir::program::PeProgram, period: u32) -> f64 {
    let busy = pe.words.iter().filter(|word| word.own.is_some() || word.imported.is_some()).count();
    busy as f64 / f64::from(period.max(1))
}

/// Shades for loads: white is the lower end, nearly black the upper.
struct Shades {
    low: f64,
    high: f64,
}

impl Shades {
    fn of(loads: &[f64]) -> Shades {
        let least = loads.iter().copied().fold(1.0, f64::min);
        let most = loads.iter().copied().fold(0.0, f64::max);
        let low = (least * 10.0 - 1e-9).floor().clamp(0.0, 9.0);
        Shades { low: low / 10.0, high: (most * 10.0 - 1e-9).ceil().max(low + 1.0) / 10.0 }
    }

    fn tone(&self, load: f64) -> Tone {
        shaded(self.share(load))
    }

    /// Text on a shade.
    fn ink(&self, load: f64) -> Tone {
        if self.share(load) > 0.5 { PAPER } else { INK }
    }

    fn share(&self, load: f64) -> f64 {
        ((load - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    /// A bar with the shades; returns where it ends.
    fn legend(&self, canvas: &Canvas, (x, y): (f64, f64)) -> f64 {
        let (steps, width) = (50, 110.0);
        let low = format!("products in {:.0} %", self.low * 100.0);
        canvas.text(&low, (x, y), SMALL, Anchor::Start);
        let x = x + text_width(&low, SMALL) + 8.0;
        for step in 0..steps {
            let from = x + width * f64::from(step) / f64::from(steps);
            let load = self.low + (self.high - self.low) * (f64::from(step) + 0.5) / f64::from(steps);
            // Wider than a step, so that no seam shows.
            canvas.fill((from, y - 6.0), (x + width, y + 6.0), self.tone(load));
        }
        canvas.frame((x, y - 6.0), (x + width, y + 6.0), SOFT, 0.8);
        let text = format!("{:.0} % of the cycles", self.high * 100.0);
        canvas.text(&text, (x + width + 8.0, y), SMALL, Anchor::Start);
        x + width + 8.0 + text_width(&text, SMALL)
    }
}

/// Draws the network of a program with its PEs at some places.
pub fn draw(program: &Program, network: &Network, places: &[Place]) -> String {
    let (pes, connections) = (network.loads.len(), network.connections());
    let busiest = network.busiest();
    let mean = network.loads.iter().sum::<f64>() / pes.max(1) as f64;
    let caption = format!(
        "{}, {connections} connections. PE {busiest} has most products: in {:.1} % of the {} cycles of a step it \
         issues one, the mean PE in {:.1} %.",
        counted(pes, "PE"),
        network.loads[busiest] * 100.0,
        program.period,
        mean * 100.0
    );
    let caption = wrapped(&caption, SMALL, EXTENT);
    let heading = format!("{}: network of PEs", program.model);
    let meshed = connections > pes + pes / 12;
    if connections > DENSE * pes || (meshed && pes > LARGE) {
        matrix(network, &heading, &caption)
    } else {
        nodes(network, places, &heading, &caption)
    }
}

/// Where the network begins below title, caption and two lines of legend.
fn head(caption: &[String]) -> f64 {
    MARGIN + TITLE + 8.0 + caption.len() as f64 * (SMALL + 4.0) + 2.0 * (LABEL + 8.0) + 6.0
}

fn nodes(network: &Network, places: &[Place], heading: &str, caption: &[String]) -> String {
    let mut places: List<PeId, _> = places.to_vec().into();
    let low = places.iter().fold((f64::MAX, f64::MAX), |low, p| (low.0.min(p.0), low.1.min(p.1)));
    let high = places.iter().fold((f64::MIN, f64::MIN), |high, p| (high.0.max(p.0), high.1.max(p.1)));
    let extent = (high.0 - low.0, high.1 - low.1);
    let least = least_distance(&places).max(1e-3);
    // As large as numbers in the nodes need, or as the picture allows.
    let wanted = match places.len() {
        0..=12 => 36.0,
        13..=100 => 24.0,
        _ => 11.0,
    };
    let room = EXTENT - 2.0 * wanted;
    let scale = (2.0 * wanted / least).min(room / extent.0.max(1e-9)).min(1.2 * room / extent.1.max(1e-9));
    let radius = (least * scale * 0.36).clamp(2.2, 13.0);
    let top = head(caption);
    let left = (WIDTH - extent.0 * scale) / 2.0;
    for place in &mut places {
        *place = (left + (place.0 - low.0) * scale, top + radius + 6.0 + (place.1 - low.1) * scale);
    }
    let height = top + extent.1 * scale + 2.0 * radius + 12.0 + MARGIN;
    let shades = Shades::of(&network.loads);
    let most = network.words.values().copied().max().unwrap_or(1) as f64;
    let width = |words: u64| 0.6 + (words as f64 / most).sqrt() * (radius / 4.0).clamp(0.8, 3.0);
    picture(heading, (WIDTH, height.ceil()), |canvas| {
        let y = title(canvas, heading, caption, EXTENT) + LABEL / 2.0 + 2.0;
        let x = shades.legend(canvas, (MARGIN, y)) + 24.0;
        arrow(canvas, ((x - radius, y), (x + 26.0 + radius, y)), radius, width(most as u64));
        canvas.text(&format!("{most} words per step"), (x + 32.0, y), SMALL, Anchor::Start);
        legend_of_shapes(canvas, y + LABEL + 8.0, radius.clamp(5.0, 8.0));
        for ((from, to), words) in &network.words {
            arrow(canvas, (places[*from], places[*to]), radius, width(*words));
        }
        for (pe, place) in places.numbered() {
            let load = network.loads[pe];
            let shape = (network.reads_input[pe], network.gives_output[pe]);
            node(canvas, *place, radius, shades.tone(load), shape);
            if radius >= 8.0 {
                let size = if network.loads.len() > 100 { radius * 0.75 } else { radius * 0.85 };
                canvas.toned(&pe.to_string(), *place, size, Anchor::Middle, shades.ink(load));
            }
        }
    })
}

/// The tone of connections.
const WIRE: Tone = (140, 140, 140);

/// An arrow from a PE to another; the two directions of a connection lie side by side.
fn arrow(canvas: &Canvas, (from, to): (Place, Place), radius: f64, width: f64) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length = (dx * dx + dy * dy).sqrt().max(1e-9);
    let (dx, dy) = (dx / length, dy / length);
    let aside = (radius * 0.3).min(2.5);
    let along = |place: Place, by: f64| (place.0 + dx * by - dy * aside, place.1 + dy * by + dx * aside);
    let (tail, tip) = (along(from, radius), along(to, -radius - 0.5));
    let head = (2.5 + 1.6 * width).min(7.0).min((length - 2.0 * radius).max(0.0) / 2.0);
    let foot = along(to, -radius - 0.5 - head);
    canvas.path(&[tail, foot], WIRE, width);
    let half = 0.45 * head;
    canvas.polygon(&[tip, (foot.0 - dy * half, foot.1 + dx * half), (foot.0 + dy * half, foot.1 - dx * half)], WIRE);
}

fn legend_of_shapes(canvas: &Canvas, y: f64, radius: f64) {
    let mut x = MARGIN + radius + 2.0;
    for (shape, text) in
        [((false, false), "PE"), ((true, false), "reads an external input"), ((false, true), "computes an output")]
    {
        node(canvas, (x, y), radius, PAPER, shape);
        canvas.text(text, (x + radius + 8.0, y), SMALL, Anchor::Start);
        x += 2.0 * radius + 30.0 + text_width(text, SMALL);
    }
}

/// A PE: a square if it reads an input, with a second outline if it computes an output.
fn node(canvas: &Canvas, (x, y): (f64, f64), r: f64, fill: Tone, (square, ringed): (bool, bool)) {
    let outer = r + 2.5;
    if square {
        let s = r * 0.9;
        canvas.fill((x - s, y - s), (x + s, y + s), fill);
        canvas.frame((x - s, y - s), (x + s, y + s), INK, 1.0);
        if ringed {
            let s = s + 2.5;
            canvas.frame((x - s, y - s), (x + s, y + s), INK, 1.0);
        }
    } else {
        if ringed {
            canvas.disc((x, y), outer, PAPER, INK);
        }
        canvas.disc((x, y), r, fill, INK);
    }
}

fn least_distance(places: &[(f64, f64)]) -> f64 {
    let mut least = f64::MAX;
    for (index, a) in places.iter().enumerate() {
        for b in &places[..index] {
            let (dx, dy) = (a.0 - b.0, a.1 - b.1);
            least = least.min(dx * dx + dy * dy);
        }
    }
    if least == f64::MAX { 1.0 } else { least.sqrt() }
}

fn matrix(network: &Network, heading: &str, caption: &[String]) -> String {
    let pes = network.loads.len();
    let order = close_order(pes, &network.edges());
    let mut rank = List::filled(0, pes);
    order.iter().enumerate().for_each(|(at, pe)| rank[PeId::at(*pe)] = at);
    let cell = (640.0 / pes as f64).clamp(1.6, 18.0);
    let side = cell * pes as f64;
    let top = head(caption) + 36.0;
    let left = MARGIN + 60.0;
    let bars = left + side + 24.0;
    let shades = Shades::of(&network.loads);
    let most = network.words.values().copied().max().unwrap_or(1) as f64;
    // Names of PEs where they do not touch each other.
    let every = ((SMALL + 3.0) / cell).ceil() as usize;
    picture(heading, (WIDTH, (top + side + 2.0 * MARGIN).ceil()), |canvas| {
        let y = title(canvas, heading, caption, EXTENT) + LABEL / 2.0 + 2.0;
        shades.legend(canvas, (MARGIN, y));
        let y = y + LABEL + 8.0;
        let text = format!(
            "diagonal and bars: load of the PE; elsewhere: words per step from the PE of the row to that of the column, black {most}. \
             Neighbours stand together"
        );
        canvas.text(&crate::style::fitted(&text, SMALL, EXTENT), (MARGIN, y), SMALL, Anchor::Start);
        canvas.fill((left, top), (left + side, top + side), (250, 250, 250));
        for at in (0..=pes).step_by(every.max(1)) {
            let d = at as f64 * cell;
            canvas.path(&[(left, top + d), (left + side, top + d)], GRID, 0.5);
            canvas.path(&[(left + d, top), (left + d, top + side)], GRID, 0.5);
        }
        for ((from, to), words) in &network.words {
            let shade = (200.0 * (1.0 - (*words as f64 / most).sqrt())) as u8;
            let (x, y) = (left + rank[*to] as f64 * cell, top + rank[*from] as f64 * cell);
            canvas.fill((x, y), (x + cell, y + cell), (shade, shade, shade));
        }
        for (pe, at) in rank.numbered() {
            let d = *at as f64 * cell;
            let load = network.loads[pe];
            canvas.fill((left + d, top + d), (left + d + cell, top + d + cell), shades.tone(load));
            canvas.fill((bars, top + d), (bars + load * BARS, top + d + cell), shades.tone(load));
            if at % every.max(1) == 0 {
                let name = pe.to_string();
                canvas.text(&name, (left - 5.0, top + d + cell / 2.0), SMALL, Anchor::End);
                canvas.upright(&name, (left + d + cell / 2.0, top - 5.0), SMALL, Anchor::Start);
            }
        }
        for share in [0.0, 0.5, 1.0] {
            let x = bars + share * BARS;
            canvas.path(&[(x, top - 4.0), (x, top + side)], GRID, 0.6);
            canvas.text(&format!("{:.0} %", share * 100.0), (x, top - 12.0), SMALL, Anchor::Middle);
        }
        canvas.frame((bars, top), (bars + BARS, top + side), SOFT, 1.0);
        canvas.frame((left, top), (left + side, top + side), SOFT, 1.0);
        canvas.upright("PE", (MARGIN + LABEL / 2.0, top + side / 2.0), LABEL, Anchor::Middle);
    })
}
