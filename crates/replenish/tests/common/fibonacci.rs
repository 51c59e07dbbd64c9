//! The action of `example_interfaces`, as far as tests need it.

use replenish::msg::heapless::Vec;
use replenish::msg::{Action, CdrError, CdrReader, CdrWriter, Message};

pub struct Fibonacci;

impl Action for Fibonacci {
    type Goal = Order;
    type Result = Numbers;
    type Feedback = Numbers;
    const TYPE_NAME: &'static str = "example_interfaces/action/Fibonacci";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::action::dds_::Fibonacci_";
}

/// Number of Fibonacci numbers that the client wants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Order {
    pub order: i32,
}

impl Message for Order {
    const TYPE_NAME: &'static str = "example_interfaces/action/Fibonacci_Goal";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::action::dds_::Fibonacci_Goal_";
    const MAX_SIZE: usize = 4;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i32(self.order)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.order = r.i32()?;
        Ok(())
    }
}

/// The numbers so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Numbers {
    pub sequence: Vec<i32, 64>,
}

impl Numbers {
    /// The first two.
    #[must_use]
    pub fn begin() -> Self {
        Self {
            sequence: Vec::from_slice(&[0, 1]).unwrap(),
        }
    }

    /// One more.
    pub fn grow(&mut self) {
        if let [.., a, b] = self.sequence[..] {
            self.sequence.push(a.wrapping_add(b)).unwrap();
        }
    }

    /// The first so many.
    #[must_use]
    pub fn of(order: usize) -> Self {
        let mut numbers = Self::begin();
        (2..order).for_each(|_| numbers.grow());
        numbers
    }
}

impl Message for Numbers {
    const TYPE_NAME: &'static str = "example_interfaces/action/Fibonacci_Result";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::action::dds_::Fibonacci_Result_";
    const MAX_SIZE: usize = 4 + 4 * 64;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(self.sequence.len())?;
        self.sequence.iter().try_for_each(|n| w.i32(*n))
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.sequence.clear();
        for _ in 0..r.sequence(64)? {
            self.sequence.push(r.i32()?).ok();
        }
        Ok(())
    }
}
