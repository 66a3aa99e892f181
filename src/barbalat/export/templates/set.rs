
    /// Sets a parameter, one of `SET_...`, between two steps; the change of the control fades in over `samples` samples. Returns
    /// the status, 0 if it is accepted; otherwise nothing has changed.
    pub fn set(&mut self, which: usize, value: ${number}, samples: u32) -> u32 {
        let samples = c_long::try_from(samples).unwrap_or(c_long::MAX);
        unsafe { ${name}_set(self.at(), c_int::try_from(which).unwrap_or(-1), value, samples) }
    }
