//! Certificate of a front point whose speed and turn rate change independently of each other (`ramp = "independent"`),
//! as with the `diff_drive_controller` of ROS 2.
//!
//! P2 and P3 are weaker than in [`super`] (`proof/Inertia.v::approaches_on_each_axis`): v stays between its values
//! in K, and so does w, but y = (v, ell w) may leave the segment towards the target. It stays in the smallest
//! rectangle, with sides along and across the heading, that contains K. A half-plane that contains the four corners
//! contains the rectangle, so the certificate is about the corners instead of the members of K:
//! `proof/Braking.v::four_corners_suffice`.
//!
//! From s + H on each component decreases to 0 within its own braking time, which is at most tau_o. After x seconds, y
//! is in the rectangle scaled by 1 - x/tau_o, so that mu applies as in [`super`], and the heading turns by at most half
//! of the turn at the full rate. Other robots rely on the speed limit, so no corner is faster than v_max.

use formation::Vec2;
use formation::front_point::rotate;
use formation::pose::Twist;

use super::super::Sample;
use super::super::polygon::{HalfPlane, nearest_point};
use super::{Guard, MotionBounds};

/// Factors by which the nearest twist is scaled, in the order in which they are tried. The factor 0 does not enlarge the
/// rectangle.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.0];
/// Factor that permits rounding errors of a corner's speed.
const ROUNDING_FACTOR: f64 = 1.0 + 1e-12;

/// Rectangle of velocities y in the robot's frame, m/s, with sides along and across the heading. It contains 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct VelocityRectangle {
    low: Vec2,
    high: Vec2,
}

impl VelocityRectangle {
    /// Returns the smallest rectangle that contains this one and `y`.
    fn including(self, y: Vec2) -> VelocityRectangle {
        VelocityRectangle { low: self.low.inf(&y), high: self.high.sup(&y) }
    }

    fn corners(self) -> [Vec2; 4] {
        let VelocityRectangle { low, high } = self;
        [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)]
    }

    /// Returns the maximum of |y_1|, and of |y_2|, m/s.
    fn extent(self) -> Vec2 {
        self.low.abs().sup(&self.high.abs())
    }

    /// Returns the part of this rectangle in which a corner of the smallest rectangle that contains `held` and the new
    /// y is at most as fast as `speed_max`, m/s.
    fn within_speed(self, held: VelocityRectangle, speed_max: f64) -> VelocityRectangle {
        let rest = held.extent().map(|part| (speed_max * speed_max - part * part).max(0.0).sqrt());
        let limit = Vec2::new(rest.y, rest.x);
        VelocityRectangle { low: self.low.sup(&-limit), high: self.high.inf(&limit) }
    }

    /// Returns the part of this rectangle in which a new y satisfies the half-plane `side`, in the robot's frame,
    /// together with one component of any y in `held`.
    fn within_side(self, held: VelocityRectangle, side: HalfPlane) -> VelocityRectangle {
        let minimum = |k: usize| (side.normal[k] * held.low[k]).min(side.normal[k] * held.high[k]);
        let mut part = self;
        for (k, other) in [(0, 1), (1, 0)] {
            let slope = side.normal[k];
            let limit = (side.boundary_distance + minimum(other)).max(0.0) / -slope;
            if slope > 0.0 {
                part.low[k] = part.low[k].max(limit);
            } else if slope < 0.0 {
                part.high[k] = part.high[k].min(limit);
            }
        }
        part
    }

    /// Returns the four sides, with the frame of the robot turned by `angle`, rad.
    fn half_planes(self, angle: f64) -> [HalfPlane; 4] {
        [
            (Vec2::x(), -self.low.x),
            (-Vec2::x(), self.high.x),
            (Vec2::y(), -self.low.y),
            (-Vec2::y(), self.high.y),
        ]
        .map(|(normal, boundary_distance)| HalfPlane {
            normal: rotate(angle, normal),
            boundary_distance,
        })
    }
}

impl Guard {
    /// Returns the twist nearest to `tried` with which the corners have a certificate, or `None` if the corners of the
    /// twist in force and the unexpired commands have none.
    pub(super) fn grant_within_rectangle(
        &mut self,
        sample: &Sample<'_>,
        now: Twist,
        tried: Twist,
    ) -> Option<Twist> {
        let drive = self.drive;
        let held = (self.unexpired_commands.iter().map(|(_, twist)| *twist).chain([now]))
            .fold(VelocityRectangle::default(), |rectangle, twist| {
                rectangle.including(drive.velocity_of_twist(twist))
            });
        let with = |twist: Twist| held.including(drive.velocity_of_twist(twist));
        let enclosing = with(tried);
        let extent = enclosing.extent();
        let bounds = MotionBounds {
            own_speed_max: extent.norm().min(self.v_max),
            braking_time_max: self.braking_time(drive.twist_for_velocity(extent, 0.0)),
            turn_rate_range: [enclosing.low.y, enclosing.high.y]
                .map(|lateral| lateral / drive.ell_m),
        };
        let nearest = self.nearest_in_rectangle(sample, held, tried, bounds);
        let mid = self.collect_cones(sample, self.horizons[0], bounds);
        let mut scaled = SHARES.into_iter().map(|factor| nearest.scale_by(factor));
        scaled.find(|&twist| self.permits_corners(mid, with(twist)))
    }

    /// Returns the twist nearest to `tried` with which no corner approaches a neighbor faster than b, as far as the
    /// half-planes for H + T say so. The corners of `held` may violate them, because they need a certificate for H only.
    fn nearest_in_rectangle(
        &mut self,
        sample: &Sample<'_>,
        held: VelocityRectangle,
        tried: Twist,
        bounds: MotionBounds,
    ) -> Twist {
        let mid = self.collect_cones(sample, self.horizons[1], bounds);
        let requested = self.drive.velocity_of_twist(tried);
        let mut permitted = held.including(requested);
        if self.permits_corners(mid, permitted) {
            return tried;
        }
        self.collect_half_planes();
        permitted = permitted.within_speed(held, self.v_max);
        for side in &self.half_planes {
            let normal = rotate(-mid, side.normal);
            permitted = permitted.within_side(held, HalfPlane { normal, ..*side });
        }
        self.half_planes.extend(permitted.half_planes(mid));
        let Some(u) = nearest_point(rotate(mid, requested), &self.half_planes) else {
            return tried;
        };
        self.scale_into_twist_set(self.drive.twist_for_velocity(rotate(-mid, u), 0.0))
    }

    /// Returns `true` if no corner is faster than v_max or approaches a neighbor faster than b. `mid` is the center of
    /// the range of headings, rad.
    fn permits_corners(&self, mid: f64, rectangle: VelocityRectangle) -> bool {
        rectangle.extent().norm() <= self.v_max * ROUNDING_FACTOR
            && rectangle.corners().into_iter().all(|corner| {
                let u = rotate(mid, corner);
                self.cones.iter().all(|cone| cone.permits(u))
            })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the rectangle that contains 0 and has this extent in each direction.
    fn rectangle([low_x, low_y, high_x, high_y]: [f64; 4]) -> VelocityRectangle {
        VelocityRectangle { low: -Vec2::new(low_x, low_y), high: Vec2::new(high_x, high_y) }
    }

    fn extents(maximum: f64) -> impl Strategy<Value = [f64; 4]> {
        prop::array::uniform4(0.0..maximum)
    }

    proptest! {
        /// A corner with one component of the new y and the other one of `held` has at most the maximum speed, and
        /// exactly that if the rectangle was reduced.
        #[test]
        fn part_within_speed_is_the_largest(held in extents(0.5), original in extents(2.0)) {
            let (held, original) = (rectangle(held), rectangle(original));
            let speed_max = 0.8;
            let part = original.within_speed(held, speed_max);
            let rest = Vec2::new(held.extent().y, held.extent().x);
            for k in [0, 1] {
                for (found, before) in [(part.low[k], original.low[k]), (part.high[k], original.high[k])] {
                    let speed = Vec2::new(found, rest[k]).norm();
                    prop_assert!(speed <= speed_max + 1e-12);
                    prop_assert!(found == before || (speed - speed_max).abs() < 1e-12);
                    prop_assert!(found * before >= 0.0);
                }
            }
        }

        /// Each component of the new y satisfies the half-plane with the worst other component of `held`, and lies on
        /// its boundary if the rectangle was reduced.
        #[test]
        fn part_within_a_side_is_the_largest(
            held in extents(0.2),
            original in extents(2.0),
            angle in prop_oneof![-3.2..3.2f64, Just(0.0)],
            boundary_distance in 0.2..1.0f64,
        ) {
            let (held, original) = (rectangle(held), rectangle(original));
            let side = HalfPlane { normal: rotate(angle, Vec2::x()), boundary_distance };
            let part = original.within_side(held, side);
            for (k, other) in [(0, 1), (1, 0)] {
                let worst = (side.normal[other] * held.low[other]).min(side.normal[other] * held.high[other]);
                let margin = |component: f64| side.normal[k] * component + worst + boundary_distance;
                for (found, before) in [(part.low[k], original.low[k]), (part.high[k], original.high[k])] {
                    prop_assert!(margin(found) >= -1e-12);
                    prop_assert!(found == before || margin(found).abs() < 1e-12);
                    prop_assert!(found == before || margin(before) < 0.0);
                }
            }
        }

        #[test]
        fn half_planes_contain_the_points_of_the_rectangle(
            extent in extents(1.0), (x, y) in (-1.0..1.0f64, -1.0..1.0f64), angle in -3.2..3.2f64,
        ) {
            let area = rectangle(extent);
            let is_inside = area.including(Vec2::new(x, y)) == area;
            let u = rotate(angle, Vec2::new(x, y));
            let sides = area.half_planes(angle);
            prop_assert_eq!(sides.iter().all(|side| side.normal.dot(&u) >= -side.boundary_distance), is_inside);
        }
    }
}
