// The fixed part of a native program: `pe-synth bench` puts the loops of a model in front of it.
//
//     native STEPS REPEATS THREADS INPUTS TABLES
//
// INPUTS is a file with a line of numbers per step, TABLES what the loops read. Prints the seconds of each repetition
// after one that warms up, and the states after the last step, bit by bit.
//
//     native peaks NUMBERS
//
// prints what one core can do at most: operations per second, and numbers per second that it loads and stores where as
// many of them are used again and again.

use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

type Kernel = unsafe fn(&Tables, &[u32], usize, *mut R);

/// Numbers in a line of the cache, for a start of the memory at such a line.
const LINE: usize = 64 / std::mem::size_of::<R>();

struct Call {
    kernel: Kernel,
    lanes: usize,
    level: u64,
    arguments: std::ops::Range<usize>,
    /// Of `clear`, which is called behind it.
    clear: std::ops::Range<usize>,
}

struct Tables {
    memory: Vec<R>,
    numbers: Vec<R>,
    calls: Vec<Call>,
    /// Arguments of calls in even and odd steps.
    arguments: [Vec<u32>; 2],
    inputs: Vec<usize>,
    /// Where states lie before even and odd steps.
    states: [Vec<usize>; 2],
    copies: Vec<(usize, usize, usize)>,
}

impl Tables {
    fn read(path: &str) -> Tables {
        let bytes = std::fs::read(path).expect("the tables");
        let mut words = bytes.chunks_exact(8).map(|word| u64::from_le_bytes(word.try_into().expect("eight bytes")));
        let mut section = || {
            let length = words.next().expect("a length");
            words.by_ref().take(length as usize).collect::<Vec<u64>>()
        };
        let numbers = |words: Vec<u64>| words.into_iter().map(|word| f64::from_bits(word) as R).collect::<Vec<R>>();
        let places = |words: Vec<u64>| words.into_iter().map(|word| word as usize).collect::<Vec<usize>>();
        let short = |words: Vec<u64>| words.into_iter().map(|word| word as u32).collect::<Vec<u32>>();
        let call = |words: &[u64]| {
            let [kernel, lanes, first, count, cleared] = [0, 1, 3, 4, 5].map(|word| words[word] as usize);
            let (arguments, clear) = (first..first + count, first + count..first + count + cleared);
            Call { kernel: KERNELS[kernel], lanes, level: words[2], arguments, clear }
        };
        Tables {
            memory: numbers(section()),
            numbers: aligned(numbers(section())),
            calls: section().chunks_exact(6).map(call).collect(),
            arguments: [short(section()), short(section())],
            inputs: places(section()),
            states: [places(section()), places(section())],
            copies: places(section()).chunks_exact(3).map(|copy| (copy[0], copy[1], copy[2])).collect(),
        }
    }

    /// Lanes from `first` on.
    fn row(&self, first: u32, lanes: usize) -> &[R] {
        &self.numbers[start(&self.numbers) + first as usize..][..lanes]
    }
}

/// With room in front, so that the numbers can begin at a line of the cache.
fn aligned(numbers: Vec<R>) -> Vec<R> {
    let mut all = vec![0.0; numbers.len() + LINE];
    let first = start(&all);
    all[first..first + numbers.len()].copy_from_slice(&numbers);
    all
}

/// The first number at a line of the cache.
fn start(numbers: &[R]) -> usize {
    (64 - numbers.as_ptr() as usize % 64) % 64 / std::mem::size_of::<R>()
}

/// A product and a sum, rounded once where the processor does so at once.
#[inline(always)]
fn fma(a: R, b: R, c: R) -> R {
    if cfg!(any(target_feature = "fma", target_arch = "aarch64")) { a.mul_add(b, c) } else { a * b + c }
}

// No call writes a slot that it reads, and calls of one level none that another one writes, or reads but to multiply it
// by zero.
unsafe fn row<'a>(v: *mut R, first: u32, lanes: usize) -> &'a [R] {
    std::slice::from_raw_parts(v.add(first as usize), lanes)
}

unsafe fn row_mut<'a>(v: *mut R, first: u32, lanes: usize) -> &'a mut [R] {
    std::slice::from_raw_parts_mut(v.add(first as usize), lanes)
}

fn numbers(tables: &Tables, first: u32, lanes: usize) -> &[R] {
    tables.row(first, lanes)
}

fn number(tables: &Tables, at: u32) -> R {
    tables.row(at, 1)[0]
}

/// Sums and lookups one by one.
unsafe fn list(t: &Tables, a: &[u32], n: usize, v: *mut R) {
    let mut words = a.iter().map(|word| *word as usize);
    let mut next = || words.next().expect("a word");
    for _ in 0..n {
        match next() {
            0 => {
                let (with_number, products, writes) = (next(), next(), next());
                let mut sum = 0.0;
                for product in 0..products {
                    let (operand, factor) = (*v.add(next()), next());
                    let factor = if product < with_number { number(t, factor as u32) } else { *v.add(factor) };
                    sum = fma(operand, factor, sum);
                }
                for _ in 0..writes {
                    let (target, base, weight) = (next(), next(), next());
                    *v.add(target) = fma(number(t, weight as u32), sum, *v.add(base));
                }
            }
            3 => {
                let (target, segment, among) = (next(), next(), next());
                *v.add(target) = *v.add(among + *v.add(segment) as usize);
            }
            kind => {
                let (target, argument) = (next(), next());
                *v.add(target) = segment(*v.add(argument), kind == 2) as R;
            }
        }
    }
}

/// Slots that are to be zero: stretches of some length, equally far apart.
#[inline(always)]
unsafe fn clear(a: &[u32], v: *mut R) {
    for stretches in a.chunks_exact(4) {
        let [first, length, apart, count] = [0, 1, 2, 3].map(|word| stretches[word] as usize);
        for stretch in (first..).step_by(apart.max(1)).take(count) {
            match length {
                1 => *v.add(stretch) = 0.0,
                8 => *(v.add(stretch) as *mut [R; 8]) = [0.0; 8],
                _ => std::slice::from_raw_parts_mut(v.add(stretch), length).fill(0.0),
            }
        }
    }
}

#[derive(Clone, Copy)]
struct Values(*mut R);

// Threads write different values between two barriers, and read only what was written before the last one.
unsafe impl Send for Values {}
unsafe impl Sync for Values {}

/// Lets a thread go on when all have arrived.
struct Barrier {
    threads: usize,
    arrived: AtomicUsize,
    passed: AtomicUsize,
}

impl Barrier {
    fn wait(&self) {
        if self.threads == 1 {
            return;
        }
        let passed = self.passed.load(Ordering::Acquire);
        if self.arrived.fetch_add(1, Ordering::AcqRel) + 1 == self.threads {
            self.arrived.store(0, Ordering::Relaxed);
            self.passed.store(passed + 1, Ordering::Release);
            return;
        }
        let mut tries = 0u32;
        while self.passed.load(Ordering::Acquire) == passed {
            tries += 1;
            if tries < 10_000 { std::hint::spin_loop() } else { std::thread::yield_now() }
        }
    }
}

/// The calls of a thread, level by level: neighbours, so that a core finds what it wrote itself.
fn share(calls: &[Call], (thread, threads): (usize, usize)) -> Vec<Vec<usize>> {
    let mut levels: Vec<Vec<usize>> = Vec::new();
    let mut before = None;
    for (index, call) in calls.iter().enumerate() {
        if before.replace(call.level) != Some(call.level) {
            levels.push(Vec::new());
        }
        levels.last_mut().expect("there is one").push(index);
    }
    for level in &mut levels {
        let lanes = |index: &usize| calls[*index].lanes;
        let all: usize = level.iter().map(lanes).sum();
        let mut done = 0;
        level.retain(|index| {
            let middle = done + lanes(index) / 2;
            done += lanes(index);
            middle * threads / all.max(1) == thread
        });
    }
    levels
}

/// What one thread does in all steps.
fn run(tables: &Tables, values: Values, inputs: &[Vec<R>], (thread, barrier): (usize, &Barrier)) {
    let levels = share(&tables.calls, (thread, barrier.threads));
    for (step, inputs) in inputs.iter().enumerate() {
        if thread == 0 {
            for (slot, number) in tables.inputs.iter().zip(inputs) {
                unsafe { *values.0.add(*slot) = *number }
            }
        }
        barrier.wait();
        let arguments = &tables.arguments[step % 2];
        for (number, level) in levels.iter().enumerate() {
            // Up and down in turn: what was written last is read first.
            let upwards = (number + step * levels.len()) % 2 == 0;
            for place in 0..level.len() {
                let index = level[if upwards { place } else { level.len() - 1 - place }];
                let call = &tables.calls[index];
                unsafe {
                    (call.kernel)(tables, &arguments[call.arguments.clone()], call.lanes, values.0);
                    clear(&arguments[call.clear.clone()], values.0);
                }
            }
            barrier.wait();
        }
        if thread == 0 {
            for (from, to, length) in &tables.copies {
                unsafe { std::ptr::copy(values.0.add(*from), values.0.add(*to), *length) }
            }
        }
    }
    barrier.wait();
}

/// The largest rate of some repetitions, each of which does `amount`.
fn fastest(amount: f64, mut work: impl FnMut()) -> f64 {
    let mut rate = 0.0f64;
    for _ in 0..20 {
        let clock = Instant::now();
        work();
        rate = rate.max(amount / clock.elapsed().as_secs_f64());
    }
    rate
}

/// Products and sums on numbers in registers, ten vectors of the widest kind at once.
fn operations() -> f64 {
    const TIMES: usize = 1_000_000;
    const WIDTH: usize = 10 * LINE;
    let mut sums = [1.0 as R; WIDTH];
    fastest((2 * TIMES * WIDTH) as f64, || {
        let (a, b): (R, R) = (black_box(0.5), black_box(0.25));
        let mut here = black_box(sums);
        for _ in 0..TIMES {
            for sum in &mut here {
                *sum = fma(a, *sum, b);
            }
        }
        sums = black_box(here);
    })
}

/// `z = x + a y` over rows that are `count` numbers together.
fn moved(count: usize) -> f64 {
    let length = (count / 3).max(LINE);
    let times = (10_000_000 / length).max(1);
    let (x, y, mut z) = (vec![1.0 as R; length], vec![2.0 as R; length], vec![0.0 as R; length]);
    fastest((3 * times * length) as f64, || {
        for _ in 0..times {
            let a: R = black_box(0.5);
            for ((z, x), y) in z.iter_mut().zip(&x).zip(&y) {
                *z = fma(a, *y, *x);
            }
            black_box(&mut z);
        }
    })
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |index: usize| arguments[index].parse::<usize>().expect("a number");
    if arguments[1] == "peaks" {
        println!("operations {:e}", operations());
        println!("moved {:e}", moved(number(2)));
        return;
    }
    let (steps, repeats, threads) = (number(1), number(2), number(3));
    let text = std::fs::read_to_string(&arguments[4]).expect("a file of inputs");
    let tables = Tables::read(&arguments[5]);
    let line = |line: &str| line.split_whitespace().map(|number| number.parse().expect("a number")).collect();
    let mut inputs: Vec<Vec<R>> = text.lines().map(line).collect();
    inputs.resize(steps, Vec::new());
    let mut values = aligned(tables.memory.clone());
    let first = start(&values);
    for repeat in 0..=repeats {
        values[first..first + tables.memory.len()].copy_from_slice(&tables.memory);
        let shared = Values(values[first..].as_mut_ptr());
        let barrier = Barrier { threads, arrived: AtomicUsize::new(0), passed: AtomicUsize::new(0) };
        let clock = Instant::now();
        std::thread::scope(|scope| {
            for thread in 1..threads {
                let (tables, inputs, barrier) = (&tables, &inputs, &barrier);
                scope.spawn(move || {
                    let shared = shared;
                    run(tables, shared, inputs, (thread, barrier))
                });
            }
            run(&tables, shared, &inputs, (0, &barrier));
        });
        if repeat > 0 {
            println!("seconds {:e}", clock.elapsed().as_secs_f64());
        }
    }
    for slot in &tables.states[steps % 2] {
        println!("state {:x}", f64::from(values[first + slot]).to_bits());
    }
}
