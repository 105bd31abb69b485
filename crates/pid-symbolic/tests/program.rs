//! Programs whose values do not fit into the narrow work space.

use pid_symbolic::program::Scratch;
use pid_symbolic::{Graph, Program, Tape};

/// 70 000 values are alive at once: all squares are made before the first sum, and each is an output as well.
#[test]
fn more_values_than_the_narrow_work_space_has_slots() {
    let count = 70_000;
    let mut g = Graph::new();
    let mut outputs = Vec::new();
    let mut sum = g.zero();
    for k in 0..count {
        let (x, c) = (g.var(k % 7), g.constant(1.0 + k as f64));
        let scaled = g.mul(c, x);
        let square = g.mul(scaled, scaled);
        outputs.push(square);
        sum = g.add(sum, square);
    }
    outputs.push(sum);
    let program = Program::new(&g, &outputs);
    assert!(program.slots() > 1 << 16, "{}", program.slots());

    let z = [0.3, -1.0, 2.0, 0.7, 1.1, -0.2, 5.0];
    let mut expected = vec![0.0; outputs.len()];
    Tape::new(&g, &outputs).eval(&z, &mut expected);
    let mut found = vec![0.0; outputs.len()];
    let mut scratch = Scratch::new();
    program.eval(&mut scratch, |vars| vars.copy_from_slice(&z), [&mut found]);
    assert!(
        found
            .iter()
            .zip(&expected)
            .all(|(x, y)| x.to_bits() == y.to_bits())
    );
}

#[test]
fn says_which_variables_are_read() {
    let mut g = Graph::new();
    let (x, y) = (g.var(2), g.var(5));
    let product = g.mul(x, y);
    let program = Program::new(&g, &[product]);
    assert_eq!(program.vars(), 6);
    for (range, read) in [
        (0..2, false),
        (2..3, true),
        (3..5, false),
        (5..6, true),
        (6..60, false),
    ] {
        assert_eq!(program.reads(range.clone()), read, "{range:?}");
    }
}
