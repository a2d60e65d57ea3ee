//! temporary
use super::Bounds;
use nalgebra::{DMatrix, DVector};
pub fn minimise_in_box(h: &DMatrix<f64>, g: &DVector<f64>, b: &Bounds) -> Option<DVector<f64>> {
    let n = g.len();
    let mut x = DVector::from_fn(n, |i, _| 0f64.clamp(b.lower[i], b.upper[i]));
    // active-set by enumeration of pinned sets (3^5=243) avoided: simple iterations
    let mut pin = vec![0i8; n];
    for _ in 0..60 {
        let free: Vec<usize> = (0..n).filter(|&i| pin[i] == 0).collect();
        let mut y = x.clone();
        for i in 0..n {
            if pin[i] < 0 {
                y[i] = b.lower[i]
            }
            if pin[i] > 0 {
                y[i] = b.upper[i]
            }
        }
        if !free.is_empty() {
            let hf = DMatrix::from_fn(free.len(), free.len(), |i, j| h[(free[i], free[j])]);
            let rf = DVector::from_fn(free.len(), |i, _| {
                -g[free[i]]
                    - (0..n)
                        .filter(|k| pin[*k] != 0)
                        .map(|k| h[(free[i], k)] * y[k])
                        .sum::<f64>()
            });
            let s = hf.cholesky()?.solve(&rf);
            for (i, &k) in free.iter().enumerate() {
                y[k] = s[i];
            }
        }
        // step from x to y until bound
        let mut t = 1.0;
        let mut hit = None;
        for &k in &free {
            let d = y[k] - x[k];
            if d > 0.0 && y[k] > b.upper[k] {
                let u = (b.upper[k] - x[k]) / d;
                if u < t {
                    t = u;
                    hit = Some((k, 1i8));
                }
            }
            if d < 0.0 && y[k] < b.lower[k] {
                let u = (b.lower[k] - x[k]) / d;
                if u < t {
                    t = u;
                    hit = Some((k, -1i8));
                }
            }
        }
        x = &x + (&y - &x) * t;
        if let Some((k, s)) = hit {
            pin[k] = s;
            continue;
        }
        let gr = h * &x + g;
        let mut worst = 0.0;
        let mut w = None;
        for i in 0..n {
            if pin[i] < 0 && gr[i] < -1e-12 && -gr[i] > worst {
                worst = -gr[i];
                w = Some(i);
            }
            if pin[i] > 0 && gr[i] > 1e-12 && gr[i] > worst {
                worst = gr[i];
                w = Some(i);
            }
        }
        match w {
            Some(i) => pin[i] = 0,
            None => return Some(x),
        }
    }
    Some(x)
}
