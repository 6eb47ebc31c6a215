//! Each invariant of the independent checkers rejects a schedule or program that was broken by hand.

use crate::support::Family;
use crate::support::faults::noted;
use crate::support::flow::{Flow, Placement, format};
use pe_ir::graph::{Factor, Role};
use pe_ir::index::{ChainId, PeId};
use pe_ir::model::Solver;
use pe_ir::program::{Address, CoefficientOperand, Program, Target};
use pe_ir::schedule::Schedule;
use pe_ir::verify;
use pe_ir::word::Latency;

/// A design with transfers, inputs, factors, constants, two writes per chain, and states that are written in place.
fn flow() -> Flow {
    Flow::random(Family::Shared, (8, 3), Solver::Rk4, format(32, 25, 18), Placement::Scattered, 71)
}

fn latency(flow: &Flow) -> Latency {
    Latency::of(&flow.fixed.format)
}

/// A design with tables of both kinds.
fn tabled() -> Flow {
    Flow::tabled((8, 2), Solver::Heun, format(32, 25, 18), Placement::Scattered, 72)
}

/// Breaks the program of a design with tables and asserts that the checker says so.
fn assert_tables_rejected(message: &str, break_it: impl Fn(&Flow, &mut Program)) {
    assert_broken_program_rejected(&tabled(), message, break_it);
}

fn assert_broken_program_rejected(flow: &Flow, message: &str, break_it: impl Fn(&Flow, &mut Program)) {
    let mut program = flow.program.clone();
    break_it(flow, &mut program);
    assert_ne!(program, flow.program, "nothing was broken");
    assert_found(&verify::program::check(&program, &flow.graph, &flow.fixed, 3), message);
}

/// Asserts that one of the findings is about what was broken.
fn assert_found(violations: &[String], message: &str) {
    assert!(violations.iter().any(|text| text.contains(message)), "no `{message}` in {violations:#?}");
}

/// Breaks the schedule and asserts that the checker says so.
fn assert_schedule_rejected(message: &str, break_it: impl Fn(&Flow, &mut Schedule)) {
    let flow = flow();
    let mut schedule = flow.schedule.clone();
    break_it(&flow, &mut schedule);
    assert_ne!(schedule, flow.schedule, "nothing was broken");
    assert_found(&verify::schedule::check(&flow.graph, &flow.mapping, &schedule, latency(&flow)), message);
}

/// Breaks the program and asserts that the checker says so.
fn assert_program_rejected(message: &str, break_it: impl Fn(&Flow, &mut Program)) {
    assert_broken_program_rejected(&flow(), message, break_it);
}

/// PE of a chain.
fn pe(flow: &Flow, chain: ChainId) -> PeId {
    flow.mapping.pe_of[flow.graph.chains[chain].equation]
}

const FIRST: ChainId = ChainId::new(0);

/// The first chain that fulfils a condition.
fn chain(flow: &Flow, which: impl Fn(ChainId) -> bool) -> ChainId {
    flow.graph.chains.ids().find(|index| which(*index)).expect("the design has such a chain")
}

/// The first transfer of a computed value, or of an input.
fn transfer(flow: &Flow, input: bool) -> usize {
    let is_input = |value| matches!(flow.graph.value(value).role, Role::Input(_));
    let position = flow.schedule.transfers.iter().position(|transfer| is_input(transfer.value) == input);
    position.expect("the design has such a transfer")
}

#[test]
fn a_pe_issues_one_product_per_word() {
    assert_schedule_rejected("two operations for issue", |flow, schedule| {
        let second = chain(flow, |index| index > FIRST && pe(flow, index) == pe(flow, FIRST));
        schedule.starts[second] = schedule.starts[FIRST];
    });
}

#[test]
fn all_issues_lie_within_the_period() {
    assert_schedule_rejected("issue in word", |_, schedule| schedule.starts[FIRST] = schedule.period);
}

#[test]
fn the_issue_order_is_a_permutation() {
    assert_schedule_rejected("not a permutation", |_, schedule| schedule.order[0] = schedule.order[0].wrapping_add(1));
}

#[test]
fn a_sum_stays_in_the_hold_register_until_its_last_write() {
    assert_schedule_rejected("is lost before its last write", |flow, schedule| {
        let chains = &flow.graph.chains;
        let long = chain(flow, |index| chains[index].second.is_some());
        let other = chain(flow, |index| index != long && pe(flow, index) == pe(flow, long));
        // The next chain of the PE ends one word after this one.
        schedule.starts[other] = schedule.starts[long] + chains[long].len() - chains[other].len() + 1;
    });
}

#[test]
fn own_writes_of_a_pe_never_share_a_word() {
    assert_schedule_rejected("two operations for write", |flow, schedule| {
        let chains = &flow.graph.chains;
        let other = chain(flow, |index| index > FIRST && pe(flow, index) == pe(flow, FIRST));
        schedule.starts[other] = schedule.starts[FIRST] + chains[FIRST].len() - chains[other].len();
    });
}

#[test]
fn a_pe_receives_one_word_at_a_time() {
    assert_schedule_rejected("two operations for receive", |_, schedule| {
        let first = schedule.transfers[0];
        let same = |index: &usize| schedule.transfers[*index].to == first.to;
        let other = (1..schedule.transfers.len()).find(same).expect("a PE receives twice");
        schedule.transfers[other].receive = first.receive;
    });
}

#[test]
fn operands_are_there_before_they_are_read() {
    assert_schedule_rejected("there after", |flow, schedule| {
        let value = flow.graph.chains[FIRST].write.value;
        let reads = |index: ChainId| {
            let terms = flow.graph.chain_terms(&flow.graph.chains[index]);
            terms.iter().any(|term| term.operand == value || term.factor == Factor::Value(value))
        };
        schedule.starts[chain(flow, reads)] = 0;
    });
}

#[test]
fn operands_of_other_pes_are_received() {
    assert_schedule_rejected("never arrives", |flow, schedule| {
        schedule.transfers.remove(transfer(flow, false));
    });
}

/// An input is received after it is sampled, a word after it is sent and as long as the link carries it, and in its
/// own step.
#[test]
fn words_are_received_while_they_are_on_the_link() {
    for (message, input, later) in [
        ("input received in word", true, 0),
        ("received before it is sent", false, 0),
        ("is replaced in", false, -1),
        ("belongs to no step", false, 0),
    ] {
        let next_step = message == "is replaced in" || message == "belongs to no step";
        assert_schedule_rejected(message, |flow, schedule| {
            let begin = if next_step { schedule.period } else { 0 };
            schedule.transfers[transfer(flow, input)].receive =
                (begin + latency(flow).pause()).saturating_add_signed(later);
        });
    }
}

#[test]
fn a_state_is_overwritten_after_its_last_read() {
    assert_schedule_rejected("overwritten in", |flow, schedule| {
        let next: Vec<_> = flow.graph.states.iter().map(|(_, next)| *next).collect();
        let producer = chain(flow, |index| flow.graph.chains[index].writes().any(|write| next.contains(&write.value)));
        schedule.starts[producer] = 0;
    });
}

#[test]
fn writes_are_done_before_the_pause_point_of_the_next_step() {
    // A result of this step must not fall before this step's pause point.
    assert_schedule_rejected("belongs to no step", |flow, schedule| {
        schedule.starts[chain(flow, |index| flow.graph.chains[index].len() == 1)] = 0;
    });
}

#[test]
fn an_entry_is_read_after_the_index_of_its_argument_is_there() {
    let flow = tabled();
    let lookup = |index: ChainId| {
        let base = flow.graph.chains[index].write.base?;
        Some(flow.graph.lookup(base)?.1.argument)
    };
    let reader = chain(&flow, |index| lookup(index).is_some());
    let argument = lookup(reader).expect("chosen so");
    let producer = chain(&flow, |index| flow.graph.chains[index].write.value == argument);
    let latency = latency(&flow);
    let ends = |schedule: &Schedule, index: ChainId| schedule.starts[index] + flow.graph.chains[index].len() - 1;
    // The earliest scale word that the datasheet allows is two words after the argument's write.
    let first = ends(&flow.schedule, producer) + latency.write() + 2 - latency.scale();
    for (last, allowed) in [(first, true), (first - 1, false)] {
        let mut schedule = flow.schedule.clone();
        schedule.starts[reader] = last + 1 - flow.graph.chains[reader].len();
        let name = flow.graph.value_name(argument);
        let scale = last + latency.scale();
        let early = format!("`{name}` read in word {}, there after", scale - 1);
        let violations = verify::schedule::check(&flow.graph, &flow.mapping, &schedule, latency);
        assert_eq!(violations.iter().any(|text| text.contains(&early)), !allowed, "{early}: {violations:#?}");
    }
    let mut mapping = flow.mapping.clone();
    let equation = flow.graph.value(argument).equation.expect("it has one");
    mapping.pe_of[equation] = PeId::new(1 - mapping.pe_of[equation].number());
    let mut graph = flow.graph.clone();
    graph.chains[reader].equation = mapping
        .pe_of
        .ids()
        .find(|other| mapping.pe_of[*other] != mapping.pe_of[equation])
        .expect("two PEs have equations");
    let violations = verify::schedule::check(&graph, &mapping, &flow.schedule, latency);
    assert_found(&violations, "is looked up where its argument is not computed");
}

#[test]
fn an_entry_is_that_of_the_column_and_of_the_argument() {
    assert_tables_rejected("base Some(", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        let index = words.filter_map(|word| word.index.as_mut()).next().expect("a lookup");
        *index ^= 1;
    });
    assert_tables_rejected("base Some(Image", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        words.filter(|word| word.index.is_some()).for_each(|word| word.index = None);
    });
    assert_tables_rejected("base Some(Entry", |_, program| {
        let pe = program.pes.iter_mut().find(|pe| pe.features.octave_bits > 0).expect("a PE with octaves");
        let written = pe.words.iter_mut().filter_map(|word| word.write_index.as_mut());
        written.for_each(|(_, octaves)| *octaves = !*octaves);
    });
    assert_tables_rejected("base Some(Unknown)", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        words.filter(|word| word.write_index.is_some()).for_each(|word| word.write_index = None);
    });
}

#[test]
fn columns_are_whole_aligned_and_never_overwritten() {
    let first_column = |program: &Program| {
        let (pe, word) = program
            .pes
            .ids()
            .flat_map(|pe| (0..program.period as usize).map(move |word| (pe, word)))
            .find(|(pe, word)| program.pes[*pe].words[*word].index.is_some())
            .expect("a lookup");
        let scale = (word + 1) % program.period as usize;
        (pe, scale, usize::from(program.pes[pe].words[scale].base.expect("a column")))
    };
    assert_tables_rejected("base Some(Entry", |_, program| {
        let (pe, _, first) = first_column(program);
        program.pes[pe].base_image[first + 5] += 1;
    });
    assert_tables_rejected("base Some(Unknown)", |_, program| {
        let (pe, scale, first) = first_column(program);
        program.pes[pe].words[scale].base = Some(first as u16 + 1);
    });
    assert_tables_rejected("base Some(Unknown)", |_, program| {
        let (pe, _, first) = first_column(program);
        let pe = &mut program.pes[pe];
        let target = pe.words.iter_mut().filter_map(|word| word.write.as_mut()).find(|target| !target.own);
        let target = target.expect("a write to the base or coefficient memory alone");
        *target = Target { base: true, address: Address { word: first as u16, ..Address::default() }, ..*target };
    });
}

#[test]
fn a_write_stores_exactly_the_products_of_its_chain() {
    assert_program_rejected("first difference", |_, program| {
        let (pe, word) = noted(program, |note| note.operand.is_some())[0];
        match &mut program.pes[pe].words[word].coefficient {
            CoefficientOperand::Coefficient(value) => *value ^= 1,
            CoefficientOperand::Stored(index) => {
                let index = usize::from(*index);
                program.pes[pe].coefficient_image[index] ^= 1;
            }
        }
    });
    assert_program_rejected("products instead of", |_, program| {
        let (pe, word) = noted(program, |note| note.operand.is_some())[0];
        program.pes[pe].words[word].own = None;
        program.pes[pe].words[word].imported = None;
    });
}

#[test]
fn a_write_adds_its_base() {
    assert_program_rejected("base None instead of", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        words.filter(|word| word.base.is_some()).for_each(|word| word.base = None);
    });
}

#[test]
fn a_write_takes_its_shift() {
    assert_program_rejected("shift", |_, program| {
        let pe = program.pes.iter_mut().find(|pe| pe.features.shifts.len() > 1).expect("a PE has two shifts");
        pe.words.iter_mut().filter(|word| word.shift == 1).for_each(|word| word.shift = 0);
    });
}

#[test]
fn a_sum_is_closed_in_time() {
    assert_program_rejected("products instead of", |_, program| {
        let close = program.pes[PeId::new(0)].words.iter_mut().find(|word| word.close).expect("a chain ends");
        close.close = false;
    });
}

#[test]
fn an_operand_is_the_value_of_the_graph() {
    assert_program_rejected("first difference", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        let address = words.filter_map(|word| word.own.as_mut()).next().expect("an own operand");
        address.word ^= 1;
    });
    assert_program_rejected("first difference", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        let factors = words.filter(|word| word.own.is_some()).filter_map(|word| match &mut word.coefficient {
            CoefficientOperand::Stored(address) => Some(address),
            CoefficientOperand::Coefficient(_) => None,
        });
        *factors.last().expect("a product of two words") ^= 1;
    });
}

#[test]
fn no_word_is_overwritten_before_it_is_read() {
    assert_program_rejected("first difference", |_, program| {
        // All results of a PE land in one word.
        let pe = &mut program.pes[PeId::new(0)];
        let first = pe.words.iter().find_map(|word| word.write).expect("a write");
        pe.words.iter_mut().filter(|word| word.write.is_some()).for_each(|word| word.write = Some(first));
    });
}

#[test]
fn one_product_has_one_data_operand() {
    assert_program_rejected("two operands", |_, program| {
        let pe = program.pes.iter_mut().find(|pe| pe.features.imported_words > 0).expect("a PE that receives");
        let word = pe.words.iter_mut().find(|word| word.own.is_some()).expect("an own operand");
        word.imported = Some(Address::default());
    });
}

#[test]
fn a_received_word_is_the_one_on_the_link() {
    assert_program_rejected("receives", |_, program| {
        let pe = program.pes.iter_mut().find(|pe| pe.ports.len() > 1).expect("a PE with two ports");
        pe.ports.swap(0, 1);
    });
    assert_program_rejected("receives", |_, program| {
        let words = program.pes.iter_mut().flat_map(|pe| &mut pe.words);
        words.filter(|word| word.send).for_each(|word| word.send = false);
    });
}

#[test]
fn every_value_is_written_once_per_step() {
    assert_program_rejected("a noted write is missing", |_, program| {
        let (pe, word) = noted(program, |note| note.write.is_some())[0];
        program.pes[pe].words[word].write = None;
    });
    assert_program_rejected("written 0 times instead of 1", |_, program| {
        // Neither the operation nor its note, as if the value had been forgotten.
        let (pe, word) = noted(program, |note| note.write.is_some())[0];
        program.pes[pe].words[word].write = None;
        program.pes[pe].notes[word].write = None;
    });
    assert_program_rejected("writes a value without a name", |_, program| {
        let (pe, word) = noted(program, |note| note.write.is_none()).into_iter().next_back().expect("a free word");
        program.pes[pe].words[word].write = Some(Target { own: true, ..Target::default() });
    });
}

#[test]
fn an_output_is_captured_when_its_value_is_there() {
    assert_program_rejected("captured from another value", |_, program| {
        let output = &mut program.outputs[0];
        output.word = (output.word + 1) % program.period;
    });
}

#[test]
fn the_first_words_of_the_first_round_write_nothing() {
    // Without its initial copy a state must come from the receive in the first words, which do not act then.
    assert_program_rejected("round 0", |_, program| {
        program.states.iter_mut().for_each(|state| state.imported.clear());
    });
}
