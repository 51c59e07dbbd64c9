//! Two types of `example_interfaces` that the examples use: `AddTwoInts` and `Fibonacci`.
#![allow(dead_code, unreachable_pub, reason = "each example uses a part of it")]

use replenish::msg::heapless::Vec;
use replenish::msg::{Action, CdrError, CdrReader, CdrWriter, Message, Service};

pub struct AddTwoInts;

impl Service for AddTwoInts {
    type Request = AddTwoIntsRequest;
    type Response = AddTwoIntsResponse;
    const TYPE_NAME: &'static str = "example_interfaces/srv/AddTwoInts";
}

#[derive(Debug, Default)]
pub struct AddTwoIntsRequest {
    pub a: i64,
    pub b: i64,
}

impl Message for AddTwoIntsRequest {
    const TYPE_NAME: &'static str = "example_interfaces/srv/AddTwoInts_Request";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::srv::dds_::AddTwoInts_Request_";
    const MAX_SIZE: usize = 16;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i64(self.a)?;
        w.i64(self.b)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        (self.a, self.b) = (r.i64()?, r.i64()?);
        Ok(())
    }
}

#[derive(Debug, Default)]
pub struct AddTwoIntsResponse {
    pub sum: i64,
}

impl Message for AddTwoIntsResponse {
    const TYPE_NAME: &'static str = "example_interfaces/srv/AddTwoInts_Response";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::srv::dds_::AddTwoInts_Response_";
    const MAX_SIZE: usize = 8;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.i64(self.sum)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        self.sum = r.i64()?;
        Ok(())
    }
}

pub struct Fibonacci;

impl Action for Fibonacci {
    type Goal = FibonacciGoal;
    type Result = FibonacciResult;
    type Feedback = FibonacciFeedback;
    const TYPE_NAME: &'static str = "example_interfaces/action/Fibonacci";
    const DDS_TYPE_NAME: &'static str = "example_interfaces::action::dds_::Fibonacci_";
}

#[derive(Debug, Default)]
pub struct FibonacciGoal {
    pub order: i32,
}

impl Message for FibonacciGoal {
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

macro_rules! numbers {
    ($name:ident, $ros:literal, $dds:literal) => {
        #[derive(Debug, Default)]
        pub struct $name {
            pub sequence: Vec<i32, 64>,
        }

        impl Message for $name {
            const TYPE_NAME: &'static str = $ros;
            const DDS_TYPE_NAME: &'static str = $dds;
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
    };
}

numbers!(
    FibonacciResult,
    "example_interfaces/action/Fibonacci_Result",
    "example_interfaces::action::dds_::Fibonacci_Result_"
);
numbers!(
    FibonacciFeedback,
    "example_interfaces/action/Fibonacci_Feedback",
    "example_interfaces::action::dds_::Fibonacci_Feedback_"
);
