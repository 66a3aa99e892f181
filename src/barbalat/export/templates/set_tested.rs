
    #[test]
    fn a_parameter_that_is_no_number_is_refused_and_changes_nothing() {
        let row = SAMPLES[0].map(${number}::from_bits);
        let (measured, r) = (row[..MEASURED].try_into().unwrap(), row[MEASURED..MEASURED + COMMANDS].try_into().unwrap());
        let (mut controller, mut other) = (Controller::new(), Controller::new());
        for which in [0, ${first}, PARAMETERS, usize::MAX] {
            assert_eq!(controller.set(which, ${number}::NAN, 10), 512);
        }
        assert_eq!(controller.step(SAMPLE_TIME, measured, r, false), other.step(SAMPLE_TIME, measured, r, false));
    }
