//! Rooms behind portals, as boxes: what is bright inside one may not be bright in the whole scene.

use crate::geometry::Bounds;
use glam::Vec3;

/// A room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    low: Vec3,
    high: Vec3,
    /// How far it reaches into its walls, along each axis.
    margin: Vec3,
}

impl Room {
    /// How far the box of a room reaches beyond what bounds it.
    pub fn margin(size: Vec3) -> Vec3 {
        0.05 * size + 0.05
    }

    /// Rooms from boxes, each by two opposite corners. A box whose middle lies in another is merged with it.
    pub fn merged(boxes: impl IntoIterator<Item = [Vec3; 2]>) -> Vec<Room> {
        let middle = |[low, high]: [Vec3; 2]| 0.5 * (low + high);
        let holds = |[low, high]: [Vec3; 2], p: Vec3| p.cmpge(low).all() && p.cmple(high).all();
        let mut merged: Vec<[Vec3; 2]> = Vec::new();
        for found in boxes {
            let is_same = |known: &[Vec3; 2]| holds(*known, middle(found)) || holds(found, middle(*known));
            match merged.iter_mut().find(|known| is_same(known)) {
                Some(known) => *known = [known[0].min(found[0]), known[1].max(found[1])],
                None => merged.push(found),
            }
        }
        let room = |[low, high]: [Vec3; 2]| {
            // size = inner size + 2 · margin of that.
            let inner = ((high - low - 0.1) / 1.1).max(Vec3::ZERO);
            Room { low, high, margin: Room::margin(inner) }
        };
        merged.into_iter().map(room).collect()
    }

    /// Whether a triangle may reach into it.
    pub fn touches(&self, corners: [Vec3; 3]) -> bool {
        let Bounds { low, high } = Bounds::of(corners);
        low.cmple(self.high).all() && high.cmpge(self.low).all()
    }

    /// Whether a surface with this point and normal is inside. (The outside of its walls is not, however
    /// thin they are.)
    pub fn holds_surface(&self, point: Vec3, normal: Vec3) -> bool {
        let in_front = point + normal * self.margin;
        let within = |p: Vec3| p.cmpge(self.low).all() && p.cmple(self.high).all();
        within(point) && within(in_front)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_room_ends_at_its_walls_and_has_as_many_windows_as_it_likes() {
        let inner = [Vec3::ZERO, Vec3::new(4.0, 2.5, 5.0)];
        let found = |shift: f32| {
            let margin = Room::margin(inner[1]);
            [inner[0] - margin - shift, inner[1] + margin + shift]
        };
        let rooms = Room::merged([found(0.0), found(0.02), found(0.0).map(|corner| corner + 6.0)]);
        assert_eq!(rooms.len(), 2);
        let room = rooms[0];
        // The floor, the ceiling, a wall; then the outsides of walls of 10 and 5 cm, and the field.
        let inside = [(Vec3::Y, [2.0, 0.0, 3.0]), (Vec3::NEG_Y, [2.0, 2.5, 3.0]), (Vec3::X, [0.0, 1.0, 4.9])];
        assert!(inside.iter().all(|(normal, point)| room.holds_surface(Vec3::from_array(*point), *normal)));
        let outside =
            [(Vec3::NEG_X, [-0.1, 1.0, 3.0]), (Vec3::Z, [1.0, 1.0, 5.05]), (Vec3::Y, [9.0, 0.0, 1.0])];
        assert!(outside.iter().all(|(normal, point)| !room.holds_surface(Vec3::from_array(*point), *normal)));
    }
}
