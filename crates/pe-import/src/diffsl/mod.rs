//! DiffSL: tensors whose elements are written out one by one, with an array of the model for each.

mod parse;
mod rates;
mod tensor;

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Severity, Span};

use crate::Wanted;
use crate::expr::Expr;
use crate::model::{Kind, Model, Quantity};
use parse::Tensor;
use tensor::{Block, Evaluator, Known, lengths};

/// Cells of a matrix that stays one.
const LARGEST_MATRIX: usize = 1_024;

/// Diagonals of a matrix that is written as its diagonals.
const MOST_DIAGONALS: usize = 9;

/// Reads a model; findings instead if it cannot be expressed.
pub(crate) fn read(text: &str, wanted: &Wanted, findings: &mut Vec<Diagnostic>) -> Option<Model> {
    let tensors = parse::tensors(text, findings);
    // Names of tensors that could not be read are not known to be wrong.
    let evaluator = Evaluator::new(!findings.is_empty());
    let mut reader = Reader {
        findings,
        evaluator,
        declared: HashMap::new(),
        states: Vec::new(),
        rates: Vec::new(),
        sides: [const { None }; 2],
        model: Model { format: "DiffSL".to_owned(), ..Model::default() },
    };
    for tensor in &tensors {
        reader.tensor(tensor);
    }
    if reader.findings.iter().all(|finding| finding.severity != Severity::Error) {
        reader.rates(Span::of(0, text.len().min(1)));
        reader.outputs(wanted);
    }
    Some(reader.model)
}

/// What one side of the equations has for each state, with its place.
type Side = Vec<(Expr, Span)>;

struct Reader<'f> {
    findings: &'f mut Vec<Diagnostic>,
    evaluator: Evaluator,
    /// Names of tensors and labels, and where they are.
    declared: HashMap<String, Span>,
    /// The quantity of each state.
    states: Vec<usize>,
    /// The quantity of each derivative, if the file names them.
    rates: Vec<usize>,
    /// `M` and `F`.
    sides: [Option<(Side, Span)>; 2],
    model: Model,
}

/// How the cells of a tensor are written.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    /// In the expressions that read them.
    InPlace,
    /// Each by a name.
    Single,
    /// As an array.
    Array,
    /// A matrix as an array for each diagonal.
    Diagonals,
}

/// What a tensor is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Input,
    State,
    Rate,
    Side(usize),
    Output,
    Plain,
}

impl Reader<'_> {
    fn tensor(&mut self, tensor: &Tensor) {
        let role = match &tensor.name[..] {
            "in" => Role::Input,
            "u" => Role::State,
            "dudt" => Role::Rate,
            "M" => Role::Side(0),
            "F" => Role::Side(1),
            "out" => Role::Output,
            "stop" => {
                let finding = Diagnostic::error(codes::IMPORT_LEFT_OUT, tensor.span, "`stop` left out").into_warning();
                let help = "conditions that stop a run change no equation: the run ends with its span";
                return self.findings.push(finding.with_help(help));
            }
            "reset" => {
                let finding = Diagnostic::error(codes::IMPORT_UNSUPPORTED, tensor.span, "`reset` cannot be expressed");
                let help =
                    "a spec has no jumps of states: state what happens with a choice (`if`) on time or on a state";
                return self.findings.push(finding.with_help(help));
            }
            _ => Role::Plain,
        };
        // A list of several elements without an index is a vector as well.
        let mut indices = tensor.indices.clone();
        if indices.is_empty() && tensor.elements.len() > 1 {
            indices.push('\0');
        }
        if role != Role::Plain && indices.len() > 1 {
            let message = format!("`{}` has {} dimensions, and is a vector or a scalar", tensor.name, indices.len());
            return self.findings.push(Diagnostic::error(codes::IMPORT_SYNTAX, tensor.span, message));
        }
        if ["t", "N"].contains(&&tensor.name[..]) {
            let message = format!("`{}` has a meaning of its own", tensor.name);
            self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, tensor.span, message));
        }
        self.declare(&tensor.name, tensor.span);
        let Some(blocks) = self.blocks(tensor, &indices) else {
            // What reads it is no error of its own.
            let labels = tensor.elements.iter().filter_map(|element| element.label.as_ref());
            return labels.chain([&tensor.name]).for_each(|name| {
                self.evaluator.broken.insert(name.clone());
            });
        };
        let rank = indices.len();
        let mut shape = vec![1; rank];
        for block in &blocks {
            for (axis, length) in shape.iter_mut().enumerate() {
                *length = (*length).max(block.start[axis] + block.shape[axis]);
            }
        }
        self.cells(tensor, role, shape, blocks);
    }

    fn declare(&mut self, name: &str, span: Span) {
        if let Some(first) = self.declared.insert(name.to_owned(), span) {
            let finding = Diagnostic::error(codes::IMPORT_DUPLICATE, span, format!("`{name}` is there twice"));
            self.findings.push(finding.with_label(first, "it is here already"));
        }
    }

    /// The elements of a tensor; none with findings, if one is wrong.
    fn blocks(&mut self, tensor: &Tensor, indices: &[char]) -> Option<Vec<Block>> {
        let mut next = vec![0; indices.len()];
        let mut blocks = Vec::new();
        for element in &tensor.elements {
            self.evaluator.reads_broken = false;
            match self.evaluator.block(element, indices, &next) {
                _ if self.evaluator.reads_broken => {}
                Ok(block) => {
                    next.clone_from(&block.start);
                    if let Some(first) = next.first_mut() {
                        *first = first.saturating_add(block.shape[0]);
                    }
                    blocks.push(block);
                }
                Err(finding) => self.findings.push(finding),
            }
        }
        let all = blocks.len() == tensor.elements.len();
        // DiffSL repeats an element of one column where others have more, if it says nothing of its columns.
        let wide = |axis: usize| blocks.iter().map(|block| block.shape[axis]).max().unwrap_or(1);
        let unclear = (1..indices.len())
            .find_map(|axis| (0..blocks.len()).find(|block| blocks[*block].shape[axis] == 1 && wide(axis) > 1))
            .filter(|block| all && tensor.elements[*block].place.is_none());
        if let Some(block) = unclear {
            let finding = Diagnostic::error(
                codes::IMPORT_MATH,
                tensor.elements[block].span,
                "it does not say how many columns it has",
            );
            self.findings.push(finding.with_help("say where it stands: `(0:1, 0:3): 1.0`"));
        }
        (all && unclear.is_none()).then_some(blocks)
    }

    /// Takes the cells of a tensor in as what they are.
    fn cells(&mut self, tensor: &Tensor, role: Role, shape: Vec<usize>, blocks: Vec<Block>) {
        let count = shape.iter().try_fold(1usize, |count, length| count.checked_mul(*length));
        let Some(count) = count.filter(|count| *count <= tensor::MOST_CELLS) else {
            let message = format!("`{}` has {}", tensor.name, lengths(&shape));
            return self.findings.push(Diagnostic::error(codes::IMPORT_LIMIT, tensor.span, message));
        };
        let matrix = shape.len() > 1;
        let layout = if matches!(role, Role::Side(_)) { Layout::InPlace } else { layout(&shape, &blocks) };
        let labelled = tensor.elements.iter().any(|element| element.label.is_some());
        let mut cells: Vec<Option<(Expr, Span)>> = vec![None; count];
        let mut numbers: Vec<Option<f64>> = vec![Some(0.0); count];
        let mut whole: Option<usize> = None;
        let mut diagonals: HashMap<String, usize> = HashMap::new();
        for (element, block) in tensor.elements.iter().zip(blocks) {
            if let Some(label) = &element.label {
                self.declare(label, element.span);
            }
            let own = element.label.is_some() || labelled;
            let name = match &element.label {
                Some(label) => label.clone(),
                None if own => format!("{}_{}", tensor.name, block.start.first().copied().unwrap_or(0)),
                None => tensor.name.clone(),
            };
            let alone = if own { block.cells.len() == 1 } else { count == 1 };
            let plain =
                matches!(role, Role::Output) && block.cells.iter().all(|(_, cell, _)| matches!(cell, Expr::Name(_)));
            let array = (layout == Layout::Array && !alone && !plain).then(|| match own {
                true => self.model.array(&name),
                false => *whole.get_or_insert_with(|| self.model.array(&name)),
            });
            let mut part = Known { shape: block.shape.clone(), cells: Vec::new(), numbers: Vec::new() };
            for (place, value, number) in block.cells {
                let at: Vec<usize> = place.iter().zip(&block.start).map(|(place, start)| place + start).collect();
                let flat = at.iter().zip(&shape).fold(0, |flat, (at, length)| flat * length + at);
                if cells[flat].is_some() {
                    let message = format!("cell {at:?} of `{}` is there twice", tensor.name);
                    self.findings.push(Diagnostic::error(codes::IMPORT_DUPLICATE, element.span, message));
                }
                let cell = if layout == Layout::InPlace || plain || matrix && value.literal() == Some(0.0) {
                    value
                } else {
                    let (array, subscripts, id) = match layout {
                        Layout::Diagonals => {
                            let diagonal = diagonal(&tensor.name, at[0], at[1]);
                            let array =
                                *diagonals.entry(diagonal.clone()).or_insert_with(|| self.model.array(&diagonal));
                            (Some(array), vec![at[0]], subscripted(&diagonal, &at[..1]))
                        }
                        _ => {
                            let subscripts = if own { place } else { at };
                            let id = if alone { name.clone() } else { subscripted(&name, &subscripts) };
                            (array, subscripts, id)
                        }
                    };
                    let mut quantity = Quantity::new(id, self.group(role), element.span);
                    quantity.element = array.map(|array| (array, subscripts));
                    quantity.kind = match role {
                        Role::State => Kind::State { initial: value, rate: Expr::number(0.0) },
                        Role::Rate => Kind::Missing,
                        _ => Kind::Algebraic(value),
                    };
                    Expr::Name(self.model.add(quantity))
                };
                cells[flat] = Some((cell.clone(), element.span));
                numbers[flat] = number;
                part.cells.push(cell);
                part.numbers.push(number);
            }
            if let Some(label) = element.label.as_ref().filter(|_| part.cells.len() == part.shape.iter().product()) {
                self.evaluator.known.insert(label.clone(), part);
            }
        }
        let gap = cells.iter().position(Option::is_none).filter(|_| role != Role::Plain);
        if let Some(gap) = gap {
            let message = format!("cell {gap} of `{}` has no value", tensor.name);
            return self.findings.push(Diagnostic::error(codes::IMPORT_NO_VALUE, tensor.span, message));
        }
        // A vector is written with its zeros.
        for (index, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.is_none()) {
            let value = match whole.filter(|_| !matrix) {
                Some(array) => {
                    let mut quantity =
                        Quantity::new(subscripted(&tensor.name, &[index]), self.group(role), tensor.span);
                    quantity.element = Some((array, vec![index]));
                    quantity.kind = Kind::Algebraic(Expr::number(0.0));
                    Expr::Name(self.model.add(quantity))
                }
                None => Expr::number(0.0),
            };
            *cell = Some((value, tensor.span));
        }
        self.complete(tensor, role, Known { shape, cells: Vec::new(), numbers }, cells.into_iter().flatten().collect());
    }

    /// Keeps a tensor of which all cells are known.
    fn complete(&mut self, tensor: &Tensor, role: Role, known: Known, cells: Side) {
        let quantities = || {
            cells.iter().filter_map(|(cell, _)| if let Expr::Name(quantity) = cell { Some(*quantity) } else { None })
        };
        match role {
            Role::State => self.states = quantities().collect(),
            Role::Rate => self.rates = quantities().collect(),
            Role::Output => {
                let outputs = quantities().map(|quantity| (self.model.quantities[quantity].id.clone(), quantity));
                self.model.outputs = outputs.collect();
            }
            _ => {}
        }
        let known = Known { cells: cells.iter().map(|(cell, _)| cell.clone()).collect(), ..known };
        self.evaluator.known.insert(tensor.name.clone(), known);
        if let Role::Side(side) = role {
            self.sides[side] = Some((cells, tensor.span));
        }
    }

    fn group(&mut self, role: Role) -> usize {
        self.model.group(match role {
            Role::Input => "Inputs",
            Role::State | Role::Rate => "States",
            Role::Output => "Outputs",
            Role::Side(_) | Role::Plain => "Definitions",
        })
    }

    /// The outputs: those that are asked for, else those of the file, else all states.
    fn outputs(&mut self, wanted: &Wanted) {
        if let Wanted::Named(names) = wanted {
            self.model.outputs.clear();
            for name in names {
                let quantities = &self.model.quantities;
                let mut found: Vec<usize> =
                    (0..quantities.len()).filter(|index| quantities[*index].id == *name).collect();
                if let Some(Known { cells, .. }) = self.evaluator.known.get(name).filter(|_| found.is_empty()) {
                    found = cells
                        .iter()
                        .filter_map(|cell| if let Expr::Name(of) = cell { Some(*of) } else { None })
                        .collect();
                }
                if found.is_empty() {
                    self.findings.push(crate::no_output(name));
                }
                let found = found.into_iter().map(|index| (self.model.quantities[index].id.clone(), index));
                self.model.outputs.extend(found);
            }
        } else if self.model.outputs.is_empty() {
            let states = self.states.iter().map(|state| (self.model.quantities[*state].id.clone(), *state));
            self.model.outputs = states.collect();
        }
    }
}

/// `x[2]`, `A[0,3]`.
fn subscripted(name: &str, at: &[usize]) -> String {
    format!("{name}[{}]", at.iter().map(usize::to_string).collect::<Vec<_>>().join(","))
}

/// How cells are written: a matrix of few diagonals, or one that is not mostly zero, has a form of its own.
fn layout(shape: &[usize], blocks: &[Block]) -> Layout {
    let [rows, columns] = *shape else {
        let written = blocks.iter().all(|block| block.cells.iter().all(|(.., number)| number.is_some()));
        return match shape.len() {
            0 | 1 => Layout::Array,
            _ if written => Layout::InPlace,
            _ => Layout::Single,
        };
    };
    let (mut filled, mut written) = (0, true);
    let mut diagonals: Vec<(usize, usize)> = Vec::new();
    for block in blocks {
        for (place, _, number) in block.cells.iter().filter(|(_, value, _)| value.literal() != Some(0.0)) {
            filled += 1;
            written &= number.is_some();
            let (row, column) = (place[0] + block.start[0], place[1] + block.start[1]);
            let own = (column.saturating_sub(row), row.saturating_sub(column));
            if diagonals.len() <= MOST_DIAGONALS && !diagonals.contains(&own) {
                diagonals.push(own);
            }
        }
    }
    let sparse = filled * 4 <= rows * columns;
    if sparse && diagonals.len() <= MOST_DIAGONALS && filled * 2 >= diagonals.len() * rows.max(3) {
        Layout::Diagonals
    } else if !sparse && rows * columns <= LARGEST_MATRIX {
        Layout::Array
    } else if written {
        Layout::InPlace
    } else {
        Layout::Single
    }
}

/// The name of a diagonal of a matrix, whose subscripts are rows.
fn diagonal(name: &str, row: usize, column: usize) -> String {
    match (column.checked_sub(row), row.abs_diff(column)) {
        (_, 0) => format!("{name}_diagonal"),
        (Some(_), 1) => format!("{name}_above"),
        (Some(_), by) => format!("{name}_above{by}"),
        (None, 1) => format!("{name}_below"),
        (None, by) => format!("{name}_below{by}"),
    }
}
