use super::*;
use RotorPriority::{Attitude, AttitudeDown, Thrust};

const SMALL: Rotors<f64> = Rotors { arm_length: 0.225, drag_to_thrust: 0.038, limits: [0.0, 3.75] };
const PRIORITIES: [RotorPriority; 3] = [Attitude, AttitudeDown, Thrust];

fn allocate(rotors: &Rotors<f64>, demand: [f64; 4], priority: RotorPriority) -> Allocation<f64> {
    rotors.allocate(demand, priority.into())
}

/// Numbers from −1 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Rotors and a demand on them, more often than not beyond their limits.
fn drawn(random: &mut Random) -> (Rotors<f64>, [f64; 4]) {
    let min = 0.5 * random.next();
    let arm = 0.3 + 0.2 * random.next();
    let rotors = Rotors {
        arm_length: arm,
        drag_to_thrust: 0.05 + 0.04 * random.next(),
        limits: [min, min + 3.0 + 2.0 * random.next()],
    };
    let (top, range) = (4.0 * rotors.limits[1], rotors.limits[1] - min);
    let thrust = 0.5 * top + 0.8 * top * random.next();
    let torque = 2.5 * arm * range * random.next().abs();
    let yaw = 4.0 * rotors.drag_to_thrust * range * random.next();
    (rotors, [thrust, torque * random.next(), torque * random.next(), yaw])
}

fn assert_near(found: [f64; 4], expected: [f64; 4], tolerance: f64, what: &str) {
    let is_near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= tolerance);
    assert!(is_near, "{what}: {found:?} in place of {expected:?}");
}

fn unlimited(rotors: &Rotors<f64>, demand: [f64; 4]) -> [f64; 4] {
    forces(demand, rotors.arm_length, rotors.drag_to_thrust)
}

/// Thrust and torques of forces at the rotors' places.
fn wrench(rotors: &Rotors<f64>, [front, left, rear, right]: [f64; 4]) -> [f64; 4] {
    let Rotors { arm_length: l, drag_to_thrust: c, .. } = rotors;
    [front + left + rear + right, l * (left - right), l * (rear - front), c * (front - left + rear - right)]
}

#[test]
fn demands_are_allocated_as_worked_out_by_hand() {
    let asked = [4.905, 0.3, -0.2, 0.05];
    for (demand, forces, achieved) in [
        ([4.905, 0.0, 0.0, 2.82], [2.4525, 0.0, 2.4525, 0.0], [4.905, 0.0, 0.0, 0.18639]),
        (asked, [1.999642, 1.563969, 1.110753, 0.230636], asked),
        ([4.905, 0.3, -0.2, 0.5], [2.230278, 1.333333, 1.341389, 0.0], [4.905, 0.3, -0.2, 0.085057]),
        ([1.0, 0.4, 0.0, 0.0], [0.888889, 1.777778, 0.888889, 0.0], [3.555556, 0.4, 0.0, 0.0]),
        ([14.0, 0.4, 0.2, 0.1], [2.861111, 3.305556, 3.75, 1.527778], [11.444444, 0.4, 0.2, 0.067556]),
        ([4.905, 2.0, 1.0, 0.1], [0.9375, 3.75, 2.8125, 0.0], [7.5, 0.84375, 0.421875, 0.0]),
        ([-1.0, 0.0, 0.0, 0.0], [0.0; 4], [0.0; 4]),
        ([20.0, 0.0, 0.0, 0.0], [3.75; 4], [15.0, 0.0, 0.0, 0.0]),
    ] {
        let found = allocate(&SMALL, demand, Attitude);
        assert_near(found.forces, forces, 5e-7, "forces");
        assert_near(found.achieved, achieved, 5e-7, "achieved");
    }
    assert_eq!(allocate(&SMALL, asked, Attitude).achieved, asked, "to the last bit");
    // Yaw has most room where the thrust is half of the most.
    let most = allocate(&SMALL, [7.5, 0.0, 0.0, 2.82], Attitude).achieved;
    assert_near(most, [7.5, 0.0, 0.0, 0.285], 1e-12, "yaw");
}

#[test]
fn other_priorities_cut_roll_and_pitch_in_place_of_the_thrust() {
    for (demand, priorities, achieved) in [
        ([1.0, 0.4, 0.0, 0.0], &[AttitudeDown, Thrust][..], [1.0, 0.1125, 0.0, 0.0]),
        ([14.0, 0.4, 0.2, 0.1], &[AttitudeDown], [11.444444, 0.4, 0.2, 0.067556]),
        ([14.0, 0.4, 0.2, 0.1], &[Thrust], [14.0, 0.1125, 0.05625, 0.019]),
        ([4.905, 2.0, 1.0, 0.1], &[AttitudeDown, Thrust], [4.905, 0.551813, 0.275906, 0.0]),
        ([-1.0, 0.0, 0.0, 0.0], &[AttitudeDown, Thrust], [0.0; 4]),
        ([20.0, 0.0, 0.0, 0.0], &[AttitudeDown, Thrust], [15.0, 0.0, 0.0, 0.0]),
    ] {
        for &priority in priorities {
            assert_near(allocate(&SMALL, demand, priority).achieved, achieved, 5e-7, &format!("{priority:?}"));
        }
    }
}

#[test]
fn rotors_keep_their_limits_and_give_what_is_reported() {
    let mut random = Random(3);
    let mut cut = [0; 3];
    for _ in 0..20_000 {
        let (rotors, demand) = drawn(&mut random);
        for (priority, cut) in PRIORITIES.into_iter().zip(&mut cut) {
            let found = allocate(&rotors, demand, priority);
            let [min, max] = rotors.limits;
            assert!(found.forces.iter().all(|&force| min <= force && force <= max), "{found:?}");
            assert_near(found.achieved, wrench(&rotors, found.forces), 1e-12, "achieved");
            let asked = unlimited(&rotors, demand);
            assert_near(demand, wrench(&rotors, asked), 1e-11, "asked");
            // Without its yaw, too: that of yaw is what is left.
            let without_yaw = unlimited(&rotors, [demand[0], demand[1], demand[2], 0.0]);
            let fits = asked.iter().chain(&without_yaw).all(|force| (min + 1e-9..max - 1e-9).contains(force));
            assert!(!fits || found.achieved == demand, "{demand:?} fits, and isn't given: {found:?}");
            *cut += usize::from(!fits);
        }
    }
    assert!(cut.iter().all(|&cut| cut > 5_000), "{cut:?} demands beyond the limits");
}

#[test]
fn the_direction_of_roll_and_pitch_stays_and_no_torque_turns_or_grows() {
    let mut random = Random(4);
    for _ in 0..20_000 {
        let (rotors, demand) = drawn(&mut random);
        for priority in PRIORITIES {
            let [_, roll, pitch, yaw] = allocate(&rotors, demand, priority).achieved;
            let [_, p, q, r] = demand;
            assert!((roll * q - pitch * p).abs() <= 1e-14 * (1.0 + p * p + q * q), "{demand:?}");
            for (given, asked) in [(roll, p), (pitch, q), (yaw, r)] {
                assert!(given * asked >= 0.0 && given.abs() <= asked.abs(), "{given} in place of {asked}");
            }
        }
    }
}

/// True if rotors can give this at some thrust that the priority allows: each constraint as it stands, over the thrust.
fn is_feasible(rotors: &Rotors<f64>, [roll, pitch, yaw]: [f64; 3], range: [f64; 2]) -> bool {
    let [min, max] = rotors.limits;
    let needed = unlimited(rotors, [0.0, roll, pitch, yaw]);
    let lowest = needed.iter().map(|force| min - force).fold(range[0], f64::max);
    let highest = needed.iter().map(|force| max - force).fold(range[1], f64::min);
    lowest <= highest + 1e-12
}

/// The largest part for which something holds, by bisection.
fn largest(holds: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    if holds(high) {
        return high;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

#[test]
fn as_much_as_possible_is_given_in_the_order_of_the_priorities() {
    let mut random = Random(5);
    for _ in 0..5_000 {
        let (rotors, demand) = drawn(&mut random);
        let [thrust, p, q, r] = demand;
        let [min, max] = rotors.limits;
        let thrust_of_rotor = (thrust / 4.0).clamp(min, max);
        for priority in PRIORITIES {
            let range = match priority {
                Attitude => [min, max],
                AttitudeDown => [min, thrust_of_rotor],
                Thrust => [thrust_of_rotor, thrust_of_rotor],
            };
            let part = largest(|s| is_feasible(&rotors, [s * p, s * q, 0.0], range));
            let forces = unlimited(&rotors, [0.0, part * p, part * q, 0.0]);
            let most = forces.iter().copied().fold(0.0, f64::max);
            let quarter = thrust_of_rotor.clamp((min + most).min(range[1]), (max - most).max(range[0]).max(min + most));
            let of_yaw = largest(|s| is_feasible(&rotors, [part * p, part * q, s * r], [quarter, quarter]));
            let expected = [4.0 * quarter, part * p, part * q, of_yaw * r];
            let found = allocate(&rotors, demand, priority).achieved;
            assert_near(found, expected, 1e-10, &format!("{priority:?} {demand:?} {rotors:?}"));
        }
    }
}

#[test]
fn what_is_given_is_continuous_in_what_is_asked() {
    let mut random = Random(6);
    let step = 1e-9;
    for _ in 0..20_000 {
        let (rotors, demand) = drawn(&mut random);
        let near = demand.map(|asked| asked + step * random.next());
        for priority in PRIORITIES {
            let [one, other] = [demand, near].map(|demand| allocate(&rotors, demand, priority).forces);
            // A small arm or drag makes much of a torque, and parts of small torques change fast with them.
            let slope = 1.0 / rotors.arm_length + 1.0 / rotors.drag_to_thrust;
            assert_near(one, other, 10.0 * slope * step, &format!("{priority:?} {demand:?} {rotors:?}"));
        }
    }
}

#[test]
fn nothing_that_is_asked_leaves_anything_undefined() {
    for demand in [[0.0; 4], [15.0, 0.0, 0.0, 0.0], [15.0, 0.1, 0.0, 0.1], [0.0, -0.1, 0.1, -0.1], [1e12; 4]] {
        for priority in PRIORITIES {
            let found = allocate(&SMALL, demand, priority);
            assert!(found.forces.iter().chain(&found.achieved).all(|value| value.is_finite()), "{demand:?}: {found:?}");
        }
    }
}
