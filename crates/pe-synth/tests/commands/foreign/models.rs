//! What the entities of `testbenches/axi/entities` do, clock by clock, written from their purpose and not from their VHDL.

/// An entity. Words are those of a host, in the order of its map.
pub trait Entity {
    /// What it shows while it has these inputs.
    fn shows(&self, inputs: &[i64]) -> Vec<i64>;

    /// Whether it is ready.
    fn is_ready(&self) -> bool {
        false
    }

    /// An enabled clock.
    fn clock(&mut self, inputs: &[i64], start: bool);

    /// The initial state.
    fn reset(&mut self);
}

/// The lowest bits of a number, as two's complement.
fn wrapped(number: i128, bits: u32) -> i64 {
    let unused = 128 - bits;
    i64::try_from(number << unused >> unused).unwrap()
}

/// `smoothing`.
pub struct Smoothing {
    pub width: u32,
    pub shift: u32,
    pub inverts: bool,
    state: i64,
    second: bool,
    ticks: u32,
}

impl Smoothing {
    pub fn new(width: u32, shift: u32, inverts: bool) -> Smoothing {
        Smoothing { width, shift, inverts, state: 0, second: false, ticks: 0 }
    }

    fn wide(&self, x: i64) -> i128 {
        i128::from(x) * 16
    }
}

impl Entity for Smoothing {
    fn shows(&self, inputs: &[i64]) -> Vec<i64> {
        let [x, gain, slow] = inputs[..] else { panic!("three inputs") };
        let bits = self.width + 4;
        let y = if self.inverts { wrapped(-i128::from(self.state), bits) } else { self.state };
        let above = i64::from(self.wide(x) > i128::from(self.state));
        vec![above, y, (x + gain).rem_euclid(1 << self.width), self.ticks.into(), slow]
    }

    fn clock(&mut self, inputs: &[i64], _start: bool) {
        let bits = self.width + 4;
        if self.second {
            let apart = wrapped(self.wide(inputs[0]) - i128::from(self.state), bits);
            self.state = wrapped(i128::from(self.state) + i128::from(apart >> self.shift), bits);
        }
        self.second = !self.second;
        self.ticks = self.ticks.wrapping_add(1);
    }

    fn reset(&mut self) {
        (self.state, self.second, self.ticks) = (0, false, 0);
    }
}

/// `divider`.
#[derive(Default)]
pub struct Divider {
    /// Quotient so far, and what is left of the bits in front.
    result: [i64; 2],
    dividend: i64,
    divisor: i64,
    /// Bits to come.
    bits: u32,
    busy: bool,
}

impl Entity for Divider {
    fn shows(&self, _inputs: &[i64]) -> Vec<i64> {
        self.result.to_vec()
    }

    fn is_ready(&self) -> bool {
        !self.busy
    }

    fn clock(&mut self, inputs: &[i64], start: bool) {
        if start {
            let bits = 64 - inputs[0].leading_zeros();
            *self = Divider { dividend: inputs[0], divisor: inputs[1], bits, busy: true, result: [0, 0] };
        } else if self.bits > 0 {
            self.bits -= 1;
            // Long division of the bits in front.
            let front = self.dividend >> self.bits;
            let rest = 2 * self.result[1] + front % 2;
            let fits = rest >= self.divisor;
            self.result = [2 * self.result[0] + i64::from(fits), rest - if fits { self.divisor } else { 0 }];
        } else {
            self.busy = false;
        }
    }

    fn reset(&mut self) {
        *self = Divider::default();
    }
}

/// `\wire\`.
#[derive(Default)]
pub struct Counter {
    phase: u32,
    turns: u32,
    sum: i64,
    steps: i64,
}

impl Entity for Counter {
    fn shows(&self, inputs: &[i64]) -> Vec<i64> {
        let [number, class] = inputs[..] else { panic!("two inputs") };
        vec![if class == 1 { self.sum.wrapping_add(number) } else { self.sum }, self.steps]
    }

    fn is_ready(&self) -> bool {
        self.phase == self.turns
    }

    fn clock(&mut self, inputs: &[i64], _start: bool) {
        self.phase += 1;
        if self.phase > self.turns {
            self.phase = 0;
            self.turns = (self.turns + 1) % 4;
            self.sum = self.sum.wrapping_add(inputs[0]);
            self.steps += 1;
        }
    }

    fn reset(&mut self) {
        *self = Counter::default();
    }
}

/// How a step of an entity goes: so many clocks, or until it is ready.
#[derive(Clone, Copy)]
pub enum Step {
    /// Clocks.
    Clocks(u32),
    /// Until it is ready.
    Ready,
}

/// A step: outputs, and clocks from its beginning to these.
pub fn step(entity: &mut dyn Entity, inputs: &[i64], how: Step) -> (Vec<i64>, u32) {
    entity.clock(inputs, true);
    let mut clocks = 1;
    match how {
        Step::Clocks(all) => {
            while clocks < all {
                entity.clock(inputs, false);
                clocks += 1;
            }
            (entity.shows(inputs), clocks + 1)
        }
        Step::Ready => loop {
            let (ready, shown) = (entity.is_ready(), entity.shows(inputs));
            entity.clock(inputs, false);
            clocks += 1;
            if ready {
                return (shown, clocks + 1);
            }
        },
    }
}
