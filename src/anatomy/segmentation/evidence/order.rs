//! Order of organs along the directions of the body.

use super::super::extent::Extents;
use super::Named;
use crate::acoustics::Side;

/// A direction of the body along which organs have an order.
pub(super) struct Order {
    /// World axis, and whether positions ascend along it.
    axis: usize,
    ascends: bool,
    /// Words for the place of the first of two organs that are exchanged, and for the file then.
    pub is_exchanged: &'static str,
    pub file_is: &'static str,
    /// Rank of an organ in the order.
    rank: fn(&str, Option<Side>) -> Option<f64>,
    /// Least difference of two ranks that counts, and by how much the two may seem exchanged, mm; both are less for two
    /// of a kind.
    least: f64,
    margin_mm: f64,
}

pub(super) const ORDERS: [Order; 3] = [
    Order {
        axis: 0,
        ascends: true,
        is_exchanged: "lies left of",
        file_is: "mirrored",
        rank: across,
        least: 1.0,
        margin_mm: 10.0,
    },
    Order {
        axis: 1,
        ascends: true,
        is_exchanged: "lies behind",
        file_is: "back to front",
        rank: front_to_back,
        least: 2.0,
        margin_mm: 10.0,
    },
    Order {
        axis: 2,
        ascends: false,
        is_exchanged: "lies below",
        file_is: "upside down",
        rank: head_to_feet,
        least: 5.0,
        margin_mm: 20.0,
    },
];

/// From the patient's right to the left, with the spine in the middle and the large vessels close to it.
fn across(organ: &str, side: Option<Side>) -> Option<f64> {
    // The halves of the heart lie one before the other.
    match (side, organ) {
        (_, "heart_chamber") => None,
        (Some(Side::Right), _) | (None, "liver" | "gallbladder") => Some(-1.0),
        (None, "inferior_vena_cava") => Some(-0.5),
        (None, "vertebra" | "vertebrae" | "spine" | "spinal_cord" | "sacrum") => Some(0.0),
        (None, "aorta") => Some(0.5),
        (Some(Side::Left), _) | (None, "spleen" | "stomach") => Some(1.0),
        _ => None,
    }
}

fn front_to_back(organ: &str, _: Option<Side>) -> Option<f64> {
    match organ {
        "liver" | "stomach" | "gallbladder" | "heart" => Some(-1.0),
        "kidney" | "vertebra" | "vertebrae" | "spinal_cord" | "autochthon" | "sacrum" => Some(1.0),
        _ => None,
    }
}

/// By vertebrae: the number of one, counted from the head, or of those beside an organ.
fn head_to_feet(organ: &str, _: Option<Side>) -> Option<f64> {
    Some(match organ {
        "brain" => 0.0,
        "lung" => 13.0,
        "heart" => 14.0,
        "liver" | "spleen" | "stomach" => 18.0,
        "kidney" | "gallbladder" | "pancreas" => 20.0,
        "sacrum" => 26.0,
        "urinary_bladder" | "rectum" => 27.0,
        "prostate" => 28.0,
        "femur" | "head_of_femur" => 29.0,
        _ => return None,
    })
}

impl Order {
    /// Whether two organs lie in this order; `None` if there is none, or they lie too close. `slant` is the tangent of
    /// the angle by which the body may be turned about its long axis.
    pub(super) fn holds(
        &self,
        first: &Named,
        second: &Named,
        extents: &Extents,
        scale: f64,
        slant: f64,
    ) -> Option<bool> {
        let (least, margin_mm, ranks) = match (first.vertebra, second.vertebra) {
            (Some(a), Some(b)) if self.axis == 2 => (1.0, 10.0, [a, b]),
            _ => {
                let rank = |named: &Named| match named.vertebra {
                    Some(number) if self.axis == 2 => Some(number),
                    _ => (self.rank)(&named.organ, named.side),
                };
                let of_a_pair = self.axis == 0 && first.organ == second.organ;
                let margin_mm = if of_a_pair { 0.0 } else { self.margin_mm };
                (self.least, margin_mm, [rank(first)?, rank(second)?])
            }
        };
        if ranks[1] - ranks[0] < least {
            return None;
        }
        let middle = |named: &Named| extents.labels[named.label].middle_mm;
        let between = middle(second) - middle(first);
        let apart = between[self.axis] * if self.ascends { 1.0 } else { -1.0 };
        if apart > 0.0 {
            return Some(true);
        }
        // In a turned body one of two organs that lie far apart in the other horizontal direction moves past the other.
        let beside = if self.axis == 2 {
            0.0
        } else {
            between[1 - self.axis].abs()
        };
        (apart < -(margin_mm * scale).max(slant * beside)).then_some(false)
    }
}
