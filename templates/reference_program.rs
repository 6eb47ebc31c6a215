/// Takes initial words from a file: lines `pe memory address word`, all decimal, memory `own`, `base` or `imported`.
fn start_from(name: &str, images: &mut [Memories]) {
    for line in read(name).lines() {
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        let pe = &mut images[fields[0].parse::<usize>().expect("a PE is a number")];
        let image = match fields[1] {
            "own" => &mut pe.own,
            "base" => &mut pe.base,
            "imported" => &mut pe.imported,
            memory => panic!("no memory {memory}"),
        };
        image[fields[2].parse::<usize>().expect("an address is a number")] =
            fields[3].parse().expect("a word is a number");
    }
}

/// Prints lines and counts what can be compared.
struct Printer {
    out: BufWriter<std::io::Stdout>,
    quiet: bool,
    checksum: u64,
    checks: u64,
}

impl Printer {
    fn print(&mut self, line: std::fmt::Arguments) {
        if let Err(error) = writeln!(self.out, "{line}") {
            eprintln!("cannot print: {error}");
            std::process::exit(2);
        }
    }

    fn write(&mut self, Write { cycle, pe, address, value }: Write) {
        self.checks += 1;
        if self.quiet {
            for part in [cycle, pe as u64, address, value] {
                self.checksum = (self.checksum.rotate_left(5) ^ part).wrapping_mul(0x517c_c1b7_2722_0a95);
            }
        } else {
            self.print(format_args!("t {cycle} {pe} {address:x} {value:x}"));
        }
    }
}

fn fail(code: i32, what: std::fmt::Arguments) -> ! {
    eprintln!("{what}");
    std::process::exit(code);
}

fn read(name: &str) -> String {
    std::fs::read_to_string(name).unwrap_or_else(|error| fail(2, format_args!("cannot read {name}: {error}")))
}

/// Input words of every step.
fn read_stimulus(name: &str) -> Vec<Vec<i64>> {
    let text = read(name);
    let word = |digits: &str| {
        let bits = i64::from_str_radix(digits, 16).expect("stimulus words are hexadecimal");
        signed(bits, STORAGE_BITS)
    };
    text.lines().map(|line| line.split_ascii_whitespace().map(word).collect()).collect()
}

fn main() {
    let mut stimulus_name = String::from("{{ model }}_stimulus.txt");
    let mut steps = DEFAULT_STEPS;
    let mut images = images();
    let (mut quiet, mut form) = (false, Form::Clocked);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().unwrap_or_default();
        match argument.as_str() {
            "--stimulus" => stimulus_name = value(),
            "--steps" => steps = value().parse().expect("--steps takes a number"),
            "--images" => start_from(&value(), &mut images),
            "--quiet" => quiet = true,
            "--fast" => form = Form::Fast,
            _ => fail(2, format_args!("unknown argument {argument}")),
        }
    }
    let stimulus = read_stimulus(&stimulus_name);
    let mut printer = Printer { out: BufWriter::new(std::io::stdout()), quiet, checksum: 0, checks: 0 };
    let mut network = match Network::with_images(form, images) {
        Ok(network) => network,
        Err(error) => fail(1, format_args!("{error}")),
    };
    for step in 0..steps {
        let words = stimulus.get(step as usize).or(stimulus.last()).map_or(&[][..], |words| words);
        network.take_inputs(words);
        network.advance(&mut Some(&mut |write| printer.write(write)));
        for (index, pe) in PES.iter().enumerate() {
            if pe.proven && network.pe_flags(index) != 0 {
                fail(1, format_args!("PE {index}: a word is out of range, which was proven impossible"));
            }
        }
        for (index, output) in OUTPUTS.iter().enumerate() {
            let (value, beyond) = port_word(network.captured(index));
            if output.proven && beyond {
                fail(1, format_args!("output {index}: it is out of range, which was proven impossible"));
            }
            printer.print(format_args!("o {step} {index} {:x}", unsigned(value, STORAGE_BITS)));
            printer.checks += 1;
        }
        if form == Form::Fast && !quiet {
            for (index, state) in STATES.iter().enumerate() {
                printer.print(format_args!("s {step} {index} {:x}", unsigned(network.stored(state), WORD_BITS)));
                printer.checks += 1;
            }
        }
    }
    for index in 0..PES.len() {
        if network.pe_flags(index) != 0 {
            printer.print(format_args!("v {index}"));
        }
    }
    if network.flags() != 0 {
        printer.print(format_args!("v any"));
    }
    if form == Form::Clocked {
        if quiet {
            let checksum = printer.checksum;
            printer.print(format_args!("checksum {checksum:016x}"));
        }
        let clocks = if steps < 2 { 0 } else { PERIOD };
        printer.print(format_args!("c {clocks}"));
    }
    let checks = printer.checks;
    printer.print(format_args!("checks {checks}"));
    if checks == 0 {
        std::process::exit(1);
    }
}
