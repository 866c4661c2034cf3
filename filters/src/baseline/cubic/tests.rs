//! The cubic surface against closed forms, its own definition in slow steps, and the smoothness it promises.

use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::baseline::delaunay::NONE;
use crate::{Mask, Plane, Size, baseline::testing};

fn planned(mask: &Mask) -> Planned {
    let scattered = Scattered::new(&Arc::new(mask.clone())).unwrap();
    let network = Network::new(&scattered.triangulation);
    Planned { scattered, network }
}

fn fill(mask: &Mask, plane: &Plane) -> Plane {
    let size = mask.size();
    let mut out = Planes::zeros(size, 1);
    let samples = Planes::new(size, vec![plane.clone()]).unwrap();
    let outcome = planned(mask).reconstruct(&samples, &mut out, &Run::default()).unwrap();
    assert_eq!(outcome.stop, Stop::Converged);
    out.into_vec().remove(0)
}

fn wavy(y: usize, x: usize) -> f32 {
    ((y * y + 3 * x * y + 7 * x) % 19) as f32 / 19.0
}

/// The energy of one edge, by the integral of the squared second derivative of its cubic (Simpson's rule is exact).
fn bending(length: f64, rise: f64, start: f64, end: f64) -> f64 {
    let second = |t: f64| (6.0 - 12.0 * t) * rise + (6.0 * t - 4.0) * start + (6.0 * t - 2.0) * end;
    let square = |t: f64| (second(t) / length.powi(2)).powi(2);
    length * (square(0.0) + 4.0 * square(0.5) + square(1.0)) / 6.0
}

fn energy(planned: &Planned, values: &[f64], gradients: &[[f64; 2]]) -> f64 {
    let sites = &planned.scattered.triangulation.sites;
    let mut edges: Vec<(u32, u32)> = Vec::new();
    for &[a, b, c] in &planned.scattered.triangulation.triangles {
        edges.extend([(a, b), (b, c), (c, a)].map(|(i, j)| (i.min(j), i.max(j))));
    }
    edges.sort_unstable();
    edges.dedup();
    let of = |&(i, j): &(u32, u32)| {
        let (i, j) = (i as usize, j as usize);
        let e = [0, 1].map(|axis| f64::from(sites[j][axis] - sites[i][axis]));
        let along = |g: [f64; 2]| g[0] * e[0] + g[1] * e[1];
        bending(e[0].hypot(e[1]), values[j] - values[i], along(gradients[i]), along(gradients[j]))
    };
    edges.iter().map(of).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn ramps_are_exact_inside_the_hull(mask in testing::mask(20), a in -1.0..1.0_f32, b in -1.0..1.0_f32) {
        let ramp = |y: usize, x: usize| a * x as f32 + b * y as f32;
        let out = fill(&mask, &Plane::from_fn(mask.size(), ramp));
        let planned = planned(&mask);
        for (at, _) in planned.scattered.triangulation.at.iter().enumerate().filter(|(_, t)| **t != NONE) {
            let (y, x) = (at / mask.size().width, at % mask.size().width);
            // The sweeps end within 1e-5 of the range for a change, thus within a few of that of the limit; steps of 20.
            prop_assert!((out.at(y, x) - ramp(y, x)).abs() <= 40.0 * 20.0 * 1e-5);
        }
    }

    #[test]
    fn gradients_are_a_minimum(mask in testing::mask(12), site in 0..1000_usize, dx in -0.1..0.1_f64, dy in -0.1..0.1_f64) {
        let planned = planned(&mask);
        prop_assume!(!planned.scattered.triangulation.triangles.is_empty());
        let sites = &planned.scattered.triangulation.sites;
        let values: Vec<f64> = sites.iter().map(|s| f64::from(wavy(s[1] as usize, s[0] as usize))).collect();
        let (mut gradients, _) = planned.network.gradients(&values, &Run::default());
        let least = energy(&planned, &values, &gradients);
        let site = site % sites.len();
        gradients[site] = [gradients[site][0] + dx, gradients[site][1] + dy];
        prop_assert!(energy(&planned, &values, &gradients) >= least - 1e-7 * (1.0 + least));
    }

    #[test]
    fn values_and_gradients_are_met_and_edges_have_no_crease(mask in testing::mask(12)) {
        let planned = planned(&mask);
        let triangulation = &planned.scattered.triangulation;
        let values: Vec<f64> =
            triangulation.sites.iter().map(|s| f64::from(wavy(s[1] as usize, s[0] as usize))).collect();
        let (gradients, _) = planned.network.gradients(&values, &Run::default());
        for (index, sites) in triangulation.triangles.iter().enumerate() {
            let patch = planned.patch(index as u32, &values, &gradients);
            let within = Barycentric::of(triangulation.corners(index as u32));
            for k in 0..3 {
                let (site, next) = (sites[k] as usize, sites[(k + 1) % 3] as usize);
                let place = |at: usize| triangulation.sites[at].map(f64::from);
                prop_assert!((patch.at(within.at(place(site))) - values[site]).abs() < 1e-9);
                let beyond = triangulation.neighbours[index][k];
                if beyond == NONE {
                    continue;
                }
                // Derivatives across the edge from both sides, by one-sided differences that are exact for cubics to O(h).
                let other = planned.patch(beyond, &values, &gradients);
                let elsewhere = Barycentric::of(triangulation.corners(beyond));
                let (a, b) = (place(site), place(next));
                let length = (b[0] - a[0]).hypot(b[1] - a[1]);
                let normal = [(b[1] - a[1]) / length, (a[0] - b[0]) / length];
                for part in [0.2, 0.5, 0.7] {
                    let h = 1e-6;
                    let at = |step: f64| [0, 1].map(|axis| a[axis] + part * (b[axis] - a[axis]) + step * normal[axis]);
                    // Which side the patch is on does not matter: its polynomial goes on.
                    let slope = |patch: &Patch, within: &Barycentric| {
                        let inner = within.at(at(h)).iter().all(|&share| share > -1e-12);
                        let sign = if inner { 1.0 } else { -1.0 };
                        sign * (patch.at(within.at(at(sign * h))) - patch.at(within.at(at(0.0)))) / h
                    };
                    let (left, right) = (slope(&patch, &within), slope(&other, &elsewhere));
                    prop_assert!((left - right).abs() < 1e-3 * (1.0 + left.abs()), "{left} {right}");
                }
            }
        }
    }
}

#[test]
fn smooth_surfaces_come_out_better_than_from_planes() {
    let size = Size::new(60, 60);
    let mask = Mask::from_fn(size, |y, x| (y * 31 + x * 17 + y * x) % 13 == 0);
    let truth = Plane::from_fn(size, |y, x| (y as f32 / 9.0).sin() * (x as f32 / 7.0).cos());
    let error = |out: &Plane| {
        let inner = |at: &usize| (5..55).contains(&(at / 60)) && (5..55).contains(&(at % 60));
        let by = |at: usize| f64::from(out.pixels()[at] - truth.pixels()[at]).powi(2);
        (0..3600).filter(inner).map(by).sum::<f64>()
    };
    let mut planes = Planes::zeros(size, 1);
    let linear =
        crate::baseline::linear::Settings.plan(&Problem::fill(Arc::new(mask.clone())), &Run::default());
    let samples = Planes::new(size, vec![truth.clone()]).unwrap();
    linear.unwrap().reconstruct(&samples, &mut planes, &Run::default()).unwrap();
    assert!(error(&fill(&mask, &truth)) < 0.25 * error(&planes.as_slice()[0]));
}

#[test]
fn an_interrupt_ends_the_sweeps() {
    let mask = Mask::from_fn(Size::new(30, 30), |y, x| (y * 7 + x * 3) % 5 == 0);
    let samples = Planes::new(mask.size(), vec![Plane::from_fn(mask.size(), wavy)]).unwrap();
    let stop = || Some(Stop::TimeLimit);
    let mut out = Planes::zeros(mask.size(), 1);
    let run = Run { interrupt: Some(&stop) };
    let outcome = planned(&mask).reconstruct(&samples, &mut out, &run).unwrap();
    assert_eq!((outcome.stop, outcome.iterations), (Stop::TimeLimit, 1));
}

#[test]
fn threads_change_no_bit() {
    let mask = Mask::from_fn(Size::new(101, 83), |y, x| (y * 31 + x * 17 + y * x) % 23 == 0);
    let samples = Plane::from_fn(mask.size(), wavy);
    let one = testing::with_threads(1, || fill(&mask, &samples));
    assert_eq!(one, testing::with_threads(3, || fill(&mask, &samples)));
}
