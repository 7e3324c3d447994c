//! Walls and obstacles as one `visualization_msgs/MarkerArray`, sent once: discs as flat cylinders, polygons and
//! segments as lines.

use formation::obstacle::Obstacle;

use protocol::ros2::cdr::Writer;
use protocol::ros2::messages::MAP_FRAME;

/// Marker type of a disc.
const CYLINDER_MARKER: u32 = 3;
const LINE_STRIP_MARKER: u32 = 4;
const ADD_MARKER: u32 = 0;
/// Width of a line and height of a cylinder, m.
const WALL_THICKNESS_M: f64 = 0.02;
/// Color of the markers: gray.
const COLOR: [f32; 4] = [0.35, 0.38, 0.42, 1.0];

/// QoS profile of a latched topic: later subscribers also receive the last message. All fields are given, because
/// an incomplete profile is rejected.
pub(crate) const LATCHED_QOS: &str = "\
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
pub(crate) fn write_wall_markers(out: &mut Writer, walls: &[Obstacle], stamp_ns: u64) {
    out.clear();
    out.write_u32(walls.len() as u32);
    for (id, wall) in (0..).zip(walls) {
        out.write_time(stamp_ns);
        out.write_string(MAP_FRAME);
        out.write_string("walls");
        out.write_u32(id);
        let (kind, position_m, scale, points) = match wall {
            Obstacle::Disc { center_m, radius_m } => (
                CYLINDER_MARKER,
                *center_m,
                [2.0 * radius_m, 2.0 * radius_m, WALL_THICKNESS_M],
                Vec::new(),
            ),
            Obstacle::Polygon { corners_m } => {
                let mut points = corners_m.clone();
                if points.len() > 2 {
                    points.push(points[0]);
                }
                (LINE_STRIP_MARKER, [0.0; 2], [WALL_THICKNESS_M, 0.0, 0.0], points)
            }
        };
        out.write_u32(kind);
        out.write_u32(ADD_MARKER);
        // Position without rotation.
        out.write_f64s(&[position_m[0], position_m[1], 0.0, 0.0, 0.0, 0.0, 1.0]);
        out.write_f64s(&scale);
        COLOR.into_iter().for_each(|component| out.write_f32(component));
        // Lifetime 0: the marker never expires.
        out.write_time(0);
        out.write_u8(0);
        out.write_u32(points.len() as u32);
        points.into_iter().for_each(|[x_m, y_m]| out.write_f64s(&[x_m, y_m, 0.0]));
        out.write_u32(0); // colors
        out.write_string(""); // texture_resource
        out.write_time(0); // texture: header, format, data
        out.write_string("");
        out.write_string("");
        out.write_u32(0);
        out.write_u32(0); // uv_coordinates
        out.write_string(""); // text
        out.write_string(""); // mesh_resource
        out.write_string(""); // mesh_file: filename, data
        out.write_u32(0);
        out.write_u8(0); // mesh_use_embedded_materials
    }
}
