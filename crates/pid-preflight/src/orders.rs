//! Orders of columns.

/// Orders of `n` columns: all up to six, exchanges of two beyond.
pub(crate) fn orders(n: usize) -> Vec<Vec<usize>> {
    let identity: Vec<usize> = (0..n).collect();
    if n > 6 {
        let mut out = vec![identity.clone()];
        for i in 0..n {
            for j in i + 1..n {
                let mut order = identity.clone();
                order.swap(i, j);
                out.push(order);
            }
        }
        return out;
    }
    let mut out = vec![Vec::new()];
    for _ in 0..n {
        out = out
            .into_iter()
            .flat_map(|o: Vec<usize>| {
                let rest: Vec<usize> = (0..n).filter(|k| !o.contains(k)).collect();
                rest.into_iter().map(move |k| [o.as_slice(), &[k]].concat())
            })
            .collect();
    }
    out
}
