//! Walls and obstacles: all `[[wall]]` and `[[obstacle]]`.

use formation::obstacle::{CORNER_DISTANCE_M_MIN, CORNERS_MAX, ConvexityError, Obstacle};

use super::diagnostic::Diagnostic;
use super::keys;
use super::table::{TableReader, TypedValue};
use super::{Scenario, Wall};

/// Maximum number of convex parts of a scenario.
const PARTS_MAX: usize = 1000;

/// Returns all convex parts: the segments of walls, then obstacles.
pub(super) fn parse_walls(root: &TableReader<'_, keys::Root>) -> Result<Vec<Wall>, Diagnostic> {
    let mut walls = Vec::new();
    for (index, table) in root.tables(keys::Root::wall)?.into_iter().enumerate() {
        table.check_keys()?;
        add_parts(&mut walls, "wall", index, parse_segments(&table)?, &table)?;
    }
    for (index, table) in root.tables(keys::Root::obstacle)?.into_iter().enumerate() {
        add_parts(&mut walls, "obstacle", index, vec![parse_obstacle(&table)?], &table)?;
    }
    Ok(walls)
}

fn add_parts<S>(
    walls: &mut Vec<Wall>,
    what: &str,
    index: usize,
    shapes: Vec<Obstacle>,
    table: &TableReader<'_, S>,
) -> Result<(), Diagnostic> {
    let name = format!("{what} {}", index + 1);
    if walls.len() + shapes.len() > PARTS_MAX {
        return Err(table.error_at_table(
            format!("with {name} there are {} convex parts", walls.len() + shapes.len()),
            format!("expected at most {PARTS_MAX}"),
        ));
    }
    let wall = |shape| Wall { name: name.clone(), path: format!("{what}.{index}"), shape };
    walls.extend(shapes.into_iter().map(wall));
    Ok(())
}

/// Parses the segments of a `[[wall]]`.
fn parse_segments(table: &TableReader<'_, keys::Wall>) -> Result<Vec<Obstacle>, Diagnostic> {
    let list = table.required_value(keys::Wall::points_m)?;
    let points = list.points()?;
    let is_closed = table.boolean(keys::Wall::closed)?;
    let minimum = if is_closed { 3 } else { 2 };
    if points.len() < minimum {
        return Err(list.error_about_key(
            format!("has {}", format_count(points.len(), "point")),
            format!("expected {minimum} or more: a wall is made of segments between them"),
        ));
    }
    let segments = points.iter().zip(points.iter().cycle().skip(1));
    let segments = segments.take(if is_closed { points.len() } else { points.len() - 1 });
    segments
        .map(|((_, from_m), (value, to_m))| {
            let segment = Obstacle::segment(*from_m, *to_m);
            match segment.check_convex() {
                Ok(()) => Ok(segment),
                Err(_) => Err(coincident_point_error(value, "point")),
            }
        })
        .collect()
}

/// Parses an `[[obstacle]]`.
fn parse_obstacle(table: &TableReader<'_, keys::Obstacle>) -> Result<Obstacle, Diagnostic> {
    if table.kind()? == "disc" {
        let center_m = table.required_value(keys::Obstacle::center_m)?.pair()?;
        return Ok(Obstacle::Disc { center_m, radius_m: table.number(keys::Obstacle::radius_m)? });
    }
    let list = table.required_value(keys::Obstacle::corners_m)?;
    let corners = list.points()?;
    let polygon = Obstacle::Polygon { corners_m: corners.iter().map(|corner| corner.1).collect() };
    match polygon.check_convex() {
        _ if corners.len() < 3 => Err(list.error_about_key(
            format!("has {}", format_count(corners.len(), "corner")),
            "expected 3 or more; a `[[wall]]` is made of segments",
        )),
        Ok(()) => Ok(polygon),
        Err(ConvexityError::CornerCount(count)) => Err(list.error_about_key(
            format!("has {}", format_count(count, "corner")),
            format!("expected at most {CORNERS_MAX}"),
        )),
        Err(ConvexityError::CoincidentCorner(corner)) => {
            Err(coincident_point_error(&corners[corner].0, "corner"))
        }
        Err(ConvexityError::ConcaveCorner(corner)) => Err(corners[corner].0.error_about_key(
            "is where the polygon stops being convex",
            "expected it to turn the same way at all corners, once around; or several convex parts",
        )),
    }
}

/// Returns the error that a point coincides with the one before it.
fn coincident_point_error<T>(point: &TypedValue<'_, T>, what: &str) -> Diagnostic {
    point.error_about_key(
        format!("is the same point as the {what} before it"),
        format!("expected {what}s at least {CORNER_DISTANCE_M_MIN} m from their neighbors"),
    )
}

fn format_count(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

impl Scenario {
    /// Returns the corners of each closed wall, in order, m.
    pub fn closed_walls_m(&self) -> Vec<Vec<[f64; 2]>> {
        let walls = self.walls.chunk_by(|a, b| a.path == b.path);
        walls.filter_map(closed_wall_corners_m).collect()
    }
}

/// Returns the corners of a closed wall, in order, m, or `None` if it is open.
fn closed_wall_corners_m(parts: &[Wall]) -> Option<Vec<[f64; 2]>> {
    let segments = parts.iter().map(|part| match &part.shape {
        Obstacle::Polygon { corners_m } => <[[f64; 2]; 2]>::try_from(&corners_m[..]).ok(),
        Obstacle::Disc { .. } => None,
    });
    let segments: Vec<[[f64; 2]; 2]> = segments.collect::<Option<_>>()?;
    let ([first_start_m, _], [_, last_end_m]) = (segments.first()?, segments.last()?);
    (segments.len() > 2 && first_start_m == last_end_m)
        .then(|| segments.iter().map(|&[from_m, _]| from_m).collect())
}

#[cfg(test)]
mod tests {
    use crate::examples::row_of_three;

    use super::*;

    #[test]
    fn wall_with_equal_ends_is_closed_and_obstacle_is_no_wall() {
        let corners_m = [[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]];
        let wall = |path: &str, shape| Wall { name: path.into(), path: path.into(), shape };
        let polyline = |path, segments| {
            let endpoints = (0..segments).map(|i| (corners_m[i % 3], corners_m[(i + 1) % 3]));
            endpoints.map(move |(from_m, to_m)| wall(path, Obstacle::segment(from_m, to_m)))
        };
        let mut scenario = row_of_three();
        scenario.walls.extend(polyline("wall.0", 2));
        scenario.walls.extend(polyline("wall.1", 3));
        let triangle = Obstacle::Polygon { corners_m: corners_m.into() };
        let disc = Obstacle::Disc { center_m: [1.0, 1.0], radius_m: 0.5 };
        scenario.walls.extend([wall("obstacle.0", triangle), wall("obstacle.1", disc)]);
        assert_eq!(scenario.closed_walls_m(), [corners_m]);
    }
}
