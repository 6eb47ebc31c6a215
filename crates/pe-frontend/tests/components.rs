//! Components: the same model as written out by hand, and what is said where they do not fit.

mod common;

use common::source;
use pe_frontend::symbols::{SymbolKind, Symbols};
use pe_frontend::{NoFiles, Overrides, compile};
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity, Span};

const HEAD: &str = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nunits strict\n";

const CELL: &str = "component Cell(g [1/s] = 3, E [V], scale = 2*3) {
    input drive [V/s] in -5 .. 5
    param rate [1/s] = g*scale/6
    state v [V] = E
    state w[j in 1..2] [V] = E/j in -9 .. 9
    leak [V/s] = rate*(v - E)
    v' = drive - leak - rate*sum(j in 1..2: w[j])
    w[j]' = leak/j - rate*w[j]
}
";

fn compiled(text: &str, overrides: &Overrides) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    compile(&mut source(&format!("{HEAD}{text}")), &NoFiles, overrides)
}

fn model(text: &str, overrides: &Overrides) -> Model {
    compiled(text, overrides).unwrap_or_else(|errors| panic!("{errors:#?}\n{text}")).0
}

/// All of a model but places and the names of its quantities, and these names in the order of the model.
fn parts(mut model: Model) -> (String, Vec<String>) {
    let mut names = Vec::new();
    let mut take = |name: &mut String, span: &mut Span| {
        names.push(std::mem::take(name));
        *span = Span::default();
    };
    model.states.iter_mut().for_each(|state| take(&mut state.name, &mut state.span));
    model.algebraics.iter_mut().for_each(|algebraic| take(&mut algebraic.name, &mut algebraic.span));
    model.inputs.iter_mut().for_each(|input| take(&mut input.name, &mut input.span));
    model.outputs.iter_mut().for_each(|output| take(&mut output.name, &mut output.span));
    model.rates.iter_mut().for_each(|rate| rate.span = Span::default());
    (format!("{model:#?}"), names)
}

/// Compares a model of components with the same one written out, whose names differ as `rename` tells.
fn same(components: &str, written_out: &str, rename: impl Fn(&str) -> String) {
    let (one, names) = parts(model(components, &Overrides::default()));
    let (other, expected) = parts(model(written_out, &Overrides::default()));
    assert_eq!(one, other, "{components}\n{written_out}");
    assert_eq!(names.iter().map(|name| rename(name)).collect::<Vec<_>>(), expected);
}

#[test]
fn an_instance_is_its_statements_with_its_name_before_them() {
    same(
        &format!(
            "{CELL}input i [V/s] = sine(1, 1 Hz)\ninstance soma = Cell(E = -1, drive = 2*i)\noutput soma.v, soma.w, soma.leak"
        ),
        "input i [V/s] = sine(1, 1 Hz)
        param soma_g [1/s] = 3
        param soma_E [V] = -1
        param soma_scale = 6
        soma_drive [V/s] = 2*i in -5 .. 5
        param soma_rate [1/s] = soma_g*soma_scale/6
        state soma_v [V] = soma_E
        state soma_w[j in 1..2] [V] = soma_E/j in -9 .. 9
        soma_leak [V/s] = soma_rate*(soma_v - soma_E)
        soma_v' = soma_drive - soma_leak - soma_rate*sum(j in 1..2: soma_w[j])
        soma_w[j]' = soma_leak/j - soma_rate*soma_w[j]
        output soma_v, soma_w, soma_leak",
        |name| name.replace('.', "_"),
    );
}

#[test]
fn an_array_of_instances_is_one_array_of_each_quantity() {
    let name = |name: &str| match name.split_once("].") {
        // `cell[3].w[2]` is `cell_w[3,2]`.
        Some((cell, own)) => {
            let number = cell.trim_start_matches("cell[");
            match own.strip_suffix(']').and_then(|own| own.split_once('[')) {
                Some((own, inner)) => format!("cell_{own}[{number},{inner}]"),
                None => format!("cell_{own}[{number}]"),
            }
        }
        None => name.to_owned(),
    };
    same(
        &format!(
            "{CELL}index k in 1..4
            param E0[k] [V] = 0.5*k
            input i [V/s] = sine(1, 1 Hz)
            instance cell[k] = Cell(g = 1 + 0.5*k, E = E0[k], drive = i + (if k > 1 then cell[k - 1].leak else 0))
            total [V] = sum(k: cell[k].v) + cell[2].w[1]
            output cell.v, cell[4].w[2], total"
        ),
        "index k in 1..4
        param E0[k] [V] = 0.5*k
        input i [V/s] = sine(1, 1 Hz)
        param cell_g[k] [1/s] = 1 + 0.5*k
        param cell_E[k] [V] = E0[k]
        param cell_scale[k] = 6
        cell_drive[k] [V/s] = i + (if k > 1 then cell_leak[k - 1] else 0) in -5 .. 5
        param cell_rate[k] [1/s] = cell_g[k]*cell_scale[k]/6
        state cell_v[k] [V] = cell_E[k]
        state cell_w[k, j in 1..2] [V] = cell_E[k]/j in -9 .. 9
        cell_leak[k] [V/s] = cell_rate[k]*(cell_v[k] - cell_E[k])
        cell_v[k]' = cell_drive[k] - cell_leak[k] - cell_rate[k]*sum(j in 1..2: cell_w[k, j])
        cell_w[k, j]' = cell_leak[k]/j - cell_rate[k]*cell_w[k, j]
        total [V] = sum(k: cell_v[k]) + cell_w[2, 1]
        output cell_v, cell_w[4, 2], total",
        name,
    );
}

#[test]
fn components_contain_instances_blocks_and_inputs_of_their_own() {
    // The index of the instances has the name of one of the component, and `gain` that of a parameter of the spec.
    same(
        "index j in 1..2, k in 1..3
        param gain [1/s] = 4
        component Lag(tau [s]) {
            input u
            state y = 0
            y' = (u - y)/tau
        }
        component Loop(gain [1/s], n [s] = 0.01) {
            input target = square(1, 1 Hz)
            instance stage[k] = Lag(tau = 0.1*k, u = if k == 1 then act else stage[k - 1].y)
            every 20 ms {
                state m = 0
                act = m + n*gain*(target - stage[3].y)
                next m = m + n*gain*(target - stage[3].y)
            }
        }
        instance fast = Loop(gain = 2*gain)
        instance slow[j] = Loop(gain = gain/j, n = 0.02, target = fast.act)
        output fast.stage[3].y, slow[2].stage[1].y, slow.act",
        "index j in 1..2, k in 1..3
        param gain [1/s] = 4
        param fast_gain [1/s] = 2*gain
        param fast_n [s] = 0.01
        input fast_target = square(1, 1 Hz)
        param fast_stage_tau[k] [s] = 0.1*k
        fast_stage_u[k] = if k == 1 then fast_act else fast_stage_y[k - 1]
        state fast_stage_y[k] = 0
        fast_stage_y[k]' = (fast_stage_u[k] - fast_stage_y[k])/fast_stage_tau[k]
        every 20 ms {
            state fast_m = 0
            fast_act = fast_m + fast_n*fast_gain*(fast_target - fast_stage_y[3])
            next fast_m = fast_m + fast_n*fast_gain*(fast_target - fast_stage_y[3])
        }
        param slow_gain[j] [1/s] = gain/j
        param slow_n[j] [s] = 0.02
        slow_target[j] = fast_act
        param slow_stage_tau[j, k] [s] = 0.1*k
        slow_stage_u[j, k] = if k == 1 then slow_act[j] else slow_stage_y[j, k - 1]
        state slow_stage_y[j, k] = 0
        slow_stage_y[j, k]' = (slow_stage_u[j, k] - slow_stage_y[j, k])/slow_stage_tau[j, k]
        every 20 ms {
            state slow_m[j] = 0
            slow_act[j] = slow_m[j] + slow_n[j]*slow_gain[j]*(slow_target[j] - slow_stage_y[j, 3])
            next slow_m[j] = slow_m[j] + slow_n[j]*slow_gain[j]*(slow_target[j] - slow_stage_y[j, 3])
        }
        output fast_stage_y[3], slow_stage_y[2, 1], slow_act",
        |name| {
            let (path, sample) = match name.strip_suffix(".sample") {
                Some(path) => (path, ".sample"),
                None => (name, ""),
            };
            let numbers: Vec<&str> = path.split(['[', ']']).skip(1).step_by(2).collect();
            let word: String = path.split(['[', ']']).step_by(2).collect::<String>().replace('.', "_");
            let numbers = if numbers.is_empty() { String::new() } else { format!("[{}]", numbers.join(",")) };
            format!("{word}{numbers}{sample}")
        },
    );
}

#[test]
fn the_command_line_names_what_instances_have() {
    let text = format!("{CELL}index k in 1..3\ninstance cell[k] = Cell(E = 1, drive = 0)\noutput cell[1].v");
    let overrides = Overrides {
        set: vec![("cell.g".to_owned(), 5.0), ("cell[2].v".to_owned(), 0.25), ("cell[3].w[2]".to_owned(), 7.0)],
        observe: vec!["cell[2].w[1], cell.v".to_owned()],
        ..Overrides::default()
    };
    let model = model(&text, &overrides);
    let outputs: Vec<&str> = model.outputs.iter().map(|output| output.name.as_str()).collect();
    assert_eq!(outputs, ["cell[2].w[1]", "cell[1].v", "cell[2].v", "cell[3].v"]);
    let initial = |name: &str| model.states.iter().find(|state| state.name == name).unwrap().initial;
    assert_eq!((initial("cell[1].v"), initial("cell[2].v"), initial("cell[3].w[2]")), (1.0, 0.25, 7.0));
    let set = |name: &str| {
        let overrides = Overrides { set: vec![(name.to_owned(), 1.0)], ..Overrides::default() };
        compiled(&text, &overrides).err().map(|errors| errors[0].message.clone())
    };
    assert_eq!(set("cell[4].v").as_deref(), Some("`cell[4].v` does not exist and cannot be set"));
    assert!(set("cell[1].q").is_some() && set("cell.leak").is_some() && set("cell[1.v").is_some());
    let meant = |overrides: Overrides| compiled(&text, &overrides).err().and_then(|errors| errors[0].help.clone());
    let set = Overrides { set: vec![("cell[1].scal".to_owned(), 1.0)], ..Overrides::default() };
    assert_eq!(meant(set).as_deref(), Some("did you mean `cell.scale`?"));
    let observe = Overrides { observe: vec!["cel[1].v".to_owned()], ..Overrides::default() };
    assert_eq!(meant(observe).as_deref(), Some("did you mean `cell.v`?"));
}

/// Code, text at the place, and a part of the message or help.
#[test]
fn what_does_not_fit_is_said_once_and_at_its_place() {
    let used = "instance one = Cell(E = 1, drive = 0)\noutput one.v\n";
    for (text, code, place, part) in [
        ("instance a = Cel(E = 1)\noutput a.v", "E0201", "Cel", "`Cell`"),
        ("instance a = Cell(drive = 0)\noutput a.v", "E0211", "a", "not told its `E`"),
        ("instance a = Cell(E = 1)\noutput a.v", "E0211", "a", "not told its `drive`"),
        ("instance a = Cell(E = 1, drive = 0, e = 2)\noutput a.v", "E0211", "e", "`E`"),
        ("instance a = Cell(E = 1, drive = 0, leak = 2)\noutput a.v", "E0211", "leak", "no parameter or input"),
        ("instance a = Cell(E = 1, E = 1, drive = 0)\noutput a.v", "E0211", "E", "twice"),
        ("instance a = Cell(E = one.v, drive = 0)\noutput a.v", "E0208", "one.v", ""),
        ("instance a[q] = Cell(E = 1, drive = 0)\noutput a[1].v", "E0201", "q", "a[q in 1..10]"),
        ("instance one = Cell(E = 1, drive = 0)\noutput one.v", "E0203", "one", "twice"),
        ("state x = 0\nx' = 1\ninstance x = Cell(E = 1, drive = 0)\noutput one.v", "E0203", "x", "twice"),
        ("output one.q", "E0201", "one.q", ""),
        ("output one[1].v", "E0201", "one[1].v", ""),
        ("x = one.leek\noutput x", "E0201", "one.leek", "`one.leak`"),
        ("x = one.temperature\noutput x", "E0201", "one.temperature", "`one` has `g`, `E`"),
        (
            "instance a[k in 1..2] = Cell(E = 1, drive = 0)\noutput a[1].temperature",
            "E0201",
            "a[1].temperature",
            "`a` has",
        ),
        ("instance a[k in 1..2] = Cell(E = 1, drive = 0)\noutput a[1].leek", "E0201", "a[1].leek", "mean `a.leak`"),
        ("instance a[k in 1..2] = Cell(E = 1, drive = 0)\noutput aa[1].leak", "E0201", "aa[1].leak", "mean `a.leak`"),
        ("instance a[k in 1..2] = Cell(E = 1, drive = 0)\ny = a[1].w[1, 2]\noutput y", "E0207", "a[1].w[1, 2]", ""),
        ("one.v' = 3 [V/s]", "E0205", "", ""),
        (
            "component A {\n state x = y\n x' = -x\n}\ninstance a[k in 1..3] = A\ninstance b = A\noutput a.x",
            "E0201",
            "y",
            "",
        ),
        ("component A {\n x' = -x\n}\ninstance a = A\noutput a.x", "E0211", "x", "no state"),
        (
            "component A {\n state x = 0\n x' = 1\n one.v' = 0\n}\ninstance a = A\noutput a.x",
            "E0211",
            "one.v",
            "belongs",
        ),
        (
            "component A {\n instance b = B\n}\ncomponent B {\n instance a = A\n}\ninstance a = A\noutput one.w",
            "E0211",
            "A",
            "itself",
        ),
        ("component A {\n output x\n}\noutput one.w", "E0114", "output x", "outside"),
        ("component A {\n component B {\n }\n}\noutput one.w", "E0114", "component B {", "in a component"),
        ("component A {\n state x = 0\n x' = 1\noutput one.w", "E0114", "", ""),
        ("input u [V]\noutput one.w", "E0114", "input u [V]", "= sine"),
        ("component Cell {\n state x = 0\n x' = 1\n}\noutput one.w", "E0203", "Cell", "component `Cell`"),
        (
            "component A(p = 1) {\n every p {\n y = 1\n }\n}\ninstance a[k in 1..2] = A\noutput a.y",
            "E0211",
            "every p {",
            "one period",
        ),
        ("component A(p = 1, p = 2) {\n state x = p\n x' = 1\n}\noutput one.w", "E0211", "p", "two parameters"),
    ] {
        if part.is_empty() && place.is_empty() {
            assert!(compiled(&format!("{CELL}{used}{text}"), &Overrides::default()).is_err(), "{text}");
            continue;
        }
        let whole = format!("{HEAD}{CELL}{used}{text}");
        let errors = compiled(&format!("{CELL}{used}{text}"), &Overrides::default()).err().unwrap_or_default();
        let errors: Vec<_> = errors.iter().filter(|finding| finding.severity == Severity::Error).collect();
        let first = errors.first().unwrap_or_else(|| panic!("nothing wrong in {text}"));
        let found = first.span.map(|span| &whole[span.range()]);
        let said = format!("{} {}", first.message, first.help.clone().unwrap_or_default());
        assert!(first.code == code && found == Some(place) && said.contains(part), "{text}\n{errors:#?}");
        assert!(!format!("{errors:?}").contains("[]."), "{text}\n{errors:#?}");
        assert_eq!(errors.iter().filter(|error| error.span == first.span).count(), 1, "{text}\n{errors:#?}");
    }
}

#[test]
fn a_period_may_be_told() {
    let component = "component A(p = 0.1) {\n every p {\n state m = 1\n next m = m/2\n }\n}\n";
    let text = format!("{component}instance a = A\ninstance b = A(p = 0.2)\noutput a.m, b.m");
    let model = model(&text, &Overrides::default());
    assert_eq!(model.rates.iter().map(|rate| rate.period).collect::<Vec<_>>(), [0.1, 0.2]);
}

#[test]
fn an_index_of_instances_is_used_and_findings_of_one_place_are_said_once() {
    let text = "index k in 1..3\ncomponent A {\n state x = 1\n x' = -x\n}\ninstance a[k] = A\noutput a.x";
    let (_, warnings) = compiled(text, &Overrides::default()).unwrap();
    assert!(warnings.is_empty(), "{warnings:#?}");
    let text = "component A {\n state x [m] = 1\n x' = y + 1 [s]\n}\ninstance a = A\ninstance b = A\noutput a.x, b.x";
    let errors = compiled(text, &Overrides::default()).err().unwrap();
    let mut places: Vec<_> = errors.iter().map(|error| (error.span, error.code)).collect();
    places.dedup();
    assert_eq!(places.len(), errors.len(), "{errors:#?}");
}

#[test]
fn units_are_checked_within_components() {
    let text = format!("{CELL}input i [V] = 0\ninstance one = Cell(E = 1, drive = i)\noutput one.v");
    let errors = compiled(&text, &Overrides::default()).err().unwrap();
    assert_eq!(errors.iter().map(|error| error.code).collect::<Vec<_>>(), ["E0701"], "{errors:#?}");
}

#[test]
fn editors_find_own_names_in_the_component_and_instances_outside() {
    let text = "param v = 2\ncomponent A(p = v) {\n input u\n state v = p\n v' = u - v\n}\nstate x = 1\nx' = -v*one.v\n\
                instance one = A(u = x)\noutput one.v, x\n";
    let (spec, findings) = pe_frontend::parse(&mut source(text), &NoFiles);
    assert!(findings.is_empty());
    let symbols = Symbols::of(&spec);
    let at = |needle: &str, after: usize| {
        let occurrence = symbols.at((text.find(needle).unwrap() + after) as u32).unwrap();
        let symbol = &symbols.all[occurrence.symbol];
        (symbol.kind, text[occurrence.span.range()].to_owned(), symbol.scope.is_some())
    };
    assert_eq!(at("p = v", 4), (SymbolKind::State, "v".to_owned(), true));
    assert_eq!(at("u - v", 4), (SymbolKind::State, "v".to_owned(), true));
    assert_eq!(at("-v*one", 1), (SymbolKind::Param, "v".to_owned(), false));
    assert_eq!(at("*one.v", 2), (SymbolKind::Instance, "one".to_owned(), false));
    assert_eq!(at("= A(u", 2), (SymbolKind::Component, "A".to_owned(), false));
    assert_eq!(at("(u = x", 5), (SymbolKind::State, "x".to_owned(), false));
    let places = |name: &str, kind: SymbolKind| {
        let number = symbols.all.iter().position(|symbol| symbol.name == name && symbol.kind == kind).unwrap();
        symbols.places(number).count()
    };
    assert_eq!((places("one", SymbolKind::Instance), places("v", SymbolKind::Param)), (3, 2));
    assert_eq!((places("v", SymbolKind::State), places("A", SymbolKind::Component)), (4, 2));
}

#[test]
fn the_layout_indents_components_and_leaves_paths_together() {
    let text = "component A(p [V]=1,q=2){\ninput u\nevery 1 ms{\nstate m=0\nnext m=u\n}\n}\ninstance a[k in 1..3]=A(u=a [1] .m,p=2*k)\n";
    let text = text.replace("a [1] .m", "a[1].m");
    let laid_out = pe_frontend::format(&source(&text)).unwrap();
    let expected = "component A(p [V] = 1, q = 2) {\n    input u\n    every 1 ms {\n        state m = 0\n        next m = u\n    }\n}\n\
                    instance a[k in 1..3] = A(u = a[1].m, p = 2*k)\n";
    assert_eq!(laid_out, expected);
    assert_eq!(pe_frontend::format(&source(&laid_out)).unwrap(), laid_out);
}
