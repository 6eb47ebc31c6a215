// The fixed part of a native program: `pe-synth bench` puts the loops of a model and its tables in front of it.
//
//     native STEPS REPEATS THREADS INPUTS
//
// INPUTS is a file with a line of numbers per step. Prints the seconds of each repetition after one that warms up, and
// the states after the last step, bit by bit.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

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

/// What one thread does in all steps.
fn run(values: Values, inputs: &[Vec<R>], (thread, barrier): (usize, &Barrier)) {
    for inputs in inputs {
        if thread == 0 {
            for (slot, number) in INPUTS.iter().zip(inputs) {
                unsafe { *values.0.add(*slot) = *number }
            }
        }
        barrier.wait();
        for level in LEVELS {
            for tile in level.iter().skip(thread).step_by(barrier.threads) {
                unsafe { tile(values.0) }
            }
            barrier.wait();
        }
        if thread == 0 {
            for (from, to, length) in COPIES {
                unsafe { std::ptr::copy(values.0.add(*from), values.0.add(*to), *length) }
            }
        }
    }
    barrier.wait();
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |index: usize| arguments[index].parse::<usize>().expect("a number");
    let (steps, repeats, threads) = (number(1), number(2), number(3));
    let text = std::fs::read_to_string(&arguments[4]).expect("a file of inputs");
    let line = |line: &str| line.split_whitespace().map(|number| number.parse().expect("a number")).collect();
    let mut inputs: Vec<Vec<R>> = text.lines().map(line).collect();
    inputs.resize(steps, Vec::new());
    let mut values = Vec::new();
    for repeat in 0..=repeats {
        values = INITIAL.to_vec();
        let shared = Values(values.as_mut_ptr());
        let barrier = Barrier { threads, arrived: AtomicUsize::new(0), passed: AtomicUsize::new(0) };
        let clock = Instant::now();
        std::thread::scope(|scope| {
            for thread in 1..threads {
                let (inputs, barrier) = (&inputs, &barrier);
                scope.spawn(move || {
                    let shared = shared;
                    run(shared, inputs, (thread, barrier))
                });
            }
            run(shared, &inputs, (0, &barrier));
        });
        if repeat > 0 {
            println!("seconds {:e}", clock.elapsed().as_secs_f64());
        }
    }
    for slot in STATES {
        println!("state {:x}", f64::from(values[*slot]).to_bits());
    }
}
