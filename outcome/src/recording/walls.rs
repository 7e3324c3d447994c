//! Walls and obstacles as one `visualization_msgs/MarkerArray`, told once: discs as flat cylinders,
//! polygons and segments as lines.

use formation::obstacle::Obstacle;

use crate::recording::cdr::Sheet;
use crate::recording::messages::MAP;

/// Types of markers, and what is to be done with one.
const CYLINDER: u32 = 3;
const LINE_STRIP: u32 = 4;
const ADD: u32 = 0;
/// How wide a line is, and how high a cylinder, m.
const THICK_M: f64 = 0.02;
/// Gray.
const COLOR: [f32; 4] = [0.35, 0.38, 0.42, 1.0];

/// What QoS a latched topic was offered with: whoever subscribes later gets the last message too. All of it
/// is told; half a profile would not be understood.
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

/// The message.
pub(crate) fn markers(walls: &[Obstacle], stamp_ns: u64) -> Sheet {
    let mut sheet = Sheet::new();
    sheet.u32(walls.len() as u32);
    for (id, wall) in (0..).zip(walls) {
        sheet.time(stamp_ns);
        sheet.text(MAP);
        sheet.text("walls");
        sheet.u32(id);
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
        sheet.u32(kind);
        sheet.u32(ADD);
        // Position, and no rotation.
        for number in [at[0], at[1], 0.0, 0.0, 0.0, 0.0, 1.0].into_iter().chain(scale) {
            sheet.f64(number);
        }
        for part in COLOR {
            sheet.f32(part);
        }
        // It stays for ever.
        sheet.u32(0);
        sheet.u32(0);
        sheet.u8(0);
        sheet.u32(points.len() as u32);
        for [x, y] in points {
            for number in [x, y, 0.0] {
                sheet.f64(number);
            }
        }
        sheet.u32(0); // colors
        sheet.text(""); // texture_resource
        sheet.time(0); // texture: header, format, data
        sheet.text("");
        sheet.text("");
        sheet.u32(0);
        sheet.u32(0); // uv_coordinates
        sheet.text(""); // text
        sheet.text(""); // mesh_resource
        sheet.text(""); // mesh_file: filename, data
        sheet.u32(0);
        sheet.u8(0); // mesh_use_embedded_materials
    }
    sheet
}
