//! The exported controller ${name}: a safe wrapper around its C. README.md describes the functions.

use std::ffi::{c_int, c_long, c_uint, c_void};

pub const MEASURED: usize = ${measured};
pub const COMMANDS: usize = ${commands};
pub const INPUTS: usize = ${inputs};
pub const ESTIMATES: usize = ${estimates};
/// [s]
pub const SAMPLE_TIME: ${number} = ${sample_time};
${parameters}
#[allow(clashing_extern_declarations)]
extern "C" {
    fn ${name}_size() -> usize;
    fn ${name}_init(c: *mut c_void);
    fn ${name}_reset(c: *mut c_void);
    fn ${name}_start(c: *mut c_void, ${start_declared}u_now: *const ${number}, samples: c_long, keep_estimates: c_int) -> c_uint;
${set_declared}    #[allow(clippy::too_many_arguments)]
    fn ${name}_plain_step(c: *mut c_void, sample_time: ${number}, measured: *const ${number}, r: *const ${number},
        freeze: c_int, u: *mut ${number}, u_limited: *mut ${number}, theta_hat: *mut ${number}) -> c_uint;
}

/// The result of a step; `status` contains the status bits of controller.h and is 0 if there is no fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    pub u: [${number}; INPUTS],
    pub u_limited: [${number}; INPUTS],
    pub theta_hat: [${number}; ESTIMATES],
    pub status: u32,
}

/// A controller. Its state is allocated once on the heap; a step does not allocate.
#[derive(Clone, Debug)]
pub struct Controller {
    kept: Vec<u64>,
}

impl Default for Controller {
    fn default() -> Self {
        Self::new()
    }
}

impl Controller {
    /// The state in which the simulation starts.
    pub fn new() -> Self {
        let mut made = Self { kept: vec![0; unsafe { ${name}_size() }.div_ceil(8)] };
        unsafe { ${name}_init(made.at()) };
        made
    }

    fn at(&mut self) -> *mut c_void {
        self.kept.as_mut_ptr().cast()
    }

    /// Like `init`, but the last control is still held if an input is rejected.
    pub fn reset(&mut self) {
        unsafe { ${name}_reset(self.at()) }
    }

    /// Start in flight: the first control is `u_now`, and the difference fades out over this number of samples. Returns the status.
    pub fn start(&mut self, ${start_argument}u_now: &[${number}; INPUTS], samples: u32, keep_estimates: bool) -> u32 {
        let samples = c_long::try_from(samples).unwrap_or(c_long::MAX);
        unsafe { ${name}_start(self.at(), ${start_given}u_now.as_ptr(), samples, c_int::from(keep_estimates)) }
    }
${set}
    /// One sample, `sample_time` seconds after the last one. A lost measurement is NaN.
    pub fn step(&mut self, sample_time: ${number}, measured: &[${number}; MEASURED], r: &[${number}; COMMANDS], freeze: bool) -> Output {
        let mut out = Output { u: [0.0; INPUTS], u_limited: [0.0; INPUTS], theta_hat: [0.0; ESTIMATES], status: 0 };
        out.status = unsafe {
            ${name}_plain_step(self.at(), sample_time, measured.as_ptr(), r.as_ptr(), c_int::from(freeze), out.u.as_mut_ptr(),
                out.u_limited.as_mut_ptr(), out.theta_hat.as_mut_ptr())
        };
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits of the measurement, the command and the control, sample by sample.
    const SAMPLES: &[[${bits}; MEASURED + COMMANDS + INPUTS]] = &[
${samples}    ];

    #[test]
    fn the_controls_are_those_of_the_simulation_in_every_bit() {
        let mut controller = Controller::new();
        for row in SAMPLES {
            let row = row.map(${number}::from_bits);
            let (measured, rest) = row.split_at(MEASURED);
            let (r, u) = rest.split_at(COMMANDS);
            let out = controller.step(SAMPLE_TIME, measured.try_into().unwrap(), r.try_into().unwrap(), false);
            assert_eq!(out.status, 0);
            assert_eq!(out.u.map(${number}::to_bits), <[${number}; INPUTS]>::try_from(u).unwrap().map(${number}::to_bits));
        }
    }

    #[test]
    fn a_lost_measurement_is_told${and_held}() {
        let mut controller = Controller::new();
        for row in SAMPLES {
            let row = row.map(${number}::from_bits);
            let measured = row[..MEASURED].try_into().unwrap();
            let r = row[MEASURED..MEASURED + COMMANDS].try_into().unwrap();
            let before = controller.step(SAMPLE_TIME, measured, r, false);
            assert_eq!(before.status, 0);
            let out = controller.clone().step(SAMPLE_TIME, &[${number}::NAN; MEASURED], r, false);
            assert_ne!(out.status, 0);
${held}        }
    }
${set_tested}}
