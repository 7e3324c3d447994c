//! Walls and obstacles as one `visualization_msgs/MarkerArray`, sent once: discs as flat cylinders, polygons and
//! segments as lines.

use formation::obstacle::Obstacle;

use protocol::ros2::cdr::Writer;
use protocol::ros2::messages::MAP;

/// Marker type of a disc.
const CYLINDER: u32 = 3;
const LINE_STRIP: u32 = 4;
const ADD_MARKER: u32 = 0;
/// Width of a line and height of a cylinder, m.
const THICK_M: f64 = 0.02;
/// Color of the markers: gray.
const COLOR: [f32; 4] = [0.35, 0.38, 0.42, 1.0];

/// QoS profile of a latched topic: later subscribers also receive the last message. All fields are given, because
/// an incomplete profile is rejected.
pub(crate) const LATCHED: &str = "\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    sec: 2147483647
    nsec: 4294967295
  lifespan:
    sec: 2147483647
    nsec: 4294967295
  liveliness: 1
  liveliness_lease_duration:
    sec: 2147483647
    nsec: 4294967295
  avoid_ros_namespace_conventions: false
";

/// Writes the message.
pub(crate) fn markers(out: &mut Writer, walls: &[Obstacle], stamp_ns: u64) {
    out.clear();
    out.u32(walls.len() as u32);
    for (id, wall) in (0..).zip(walls) {
        out.time(stamp_ns);
        out.string(MAP);
        out.string("walls");
        out.u32(id);
        let (kind, at, scale, points) = match wall {
            Obstacle::Disc { center_m, radius_m } => {
                (CYLINDER, *center_m, [2.0 * radius_m, 2.0 * radius_m, THICK_M], Vec::new())
            }
            Obstacle::Polygon { corners_m } => {
                let mut points = corners_m.clone();
                if points.len() > 2 {
                    points.push(points[0]);
                }
                (LINE_STRIP, [0.0; 2], [THICK_M, 0.0, 0.0], points)
            }
        };
        out.u32(kind);
        out.u32(ADD_MARKER);
        // Position without rotation.
        out.f64s(&[at[0], at[1], 0.0, 0.0, 0.0, 0.0, 1.0]);
        out.f64s(&scale);
        COLOR.into_iter().for_each(|part| out.f32(part));
        // Lifetime 0: the marker never expires.
        out.time(0);
        out.u8(0);
        out.u32(points.len() as u32);
        points.into_iter().for_each(|[x_m, y_m]| out.f64s(&[x_m, y_m, 0.0]));
        out.u32(0); // colors
        out.string(""); // texture_resource
        out.time(0); // texture: header, format, data
        out.string("");
        out.string("");
        out.u32(0);
        out.u32(0); // uv_coordinates
        out.string(""); // text
        out.string(""); // mesh_resource
        out.string(""); // mesh_file: filename, data
        out.u32(0);
        out.u8(0); // mesh_use_embedded_materials
    }
}
