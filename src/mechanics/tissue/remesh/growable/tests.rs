use super::*;

fn filled(rows: usize, columns: usize) -> Growable {
    let mut grown = Growable::default();
    let mut matrix = grown.shape(rows, columns);
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        matrix[(i, j)] = (10 * i + j) as f64;
    }
    grown
}

#[test]
fn values_stay_when_it_grows_and_what_is_new_is_zero() {
    let mut grown = filled(3, 4);
    grown.extend(40, 50);
    let matrix = grown.get();
    assert_eq!((matrix.nrows(), matrix.ncols()), (40, 50));
    for (i, j) in (0..40).flat_map(|i| (0..50).map(move |j| (i, j))) {
        let expected = if i < 3 && j < 4 { (10 * i + j) as f64 } else { 0.0 };
        assert_eq!(matrix[(i, j)], expected, "({i}, {j})");
    }
    // Former contents of a shrunken matrix do not reappear.
    grown.get_mut().fill(7.0);
    grown.shape(2, 2);
    grown.extend(3, 3);
    assert_eq!(grown.get()[(1, 1)], 7.0);
    assert_eq!(
        [grown.get()[(2, 0)], grown.get()[(0, 2)], grown.get()[(2, 2)]],
        [0.0; 3]
    );
}

#[test]
fn memory_is_kept_when_it_shrinks() {
    let mut grown = filled(30, 30);
    let (bytes, address) = (grown.bytes(), grown.get().as_ptr());
    grown.shape(2, 3);
    grown.shape(30, 30);
    assert_eq!((grown.bytes(), grown.get().as_ptr()), (bytes, address));
}

#[test]
fn the_last_takes_the_place_of_what_is_taken_out() {
    let mut grown = filled(3, 3);
    grown.take_row(0);
    assert_eq!(grown.get(), faer::mat![[20.0, 21.0, 22.0], [10.0, 11.0, 12.0]]);
    grown.take_column(1);
    assert_eq!(grown.get(), faer::mat![[20.0, 22.0], [10.0, 12.0]]);
    grown.take_column(1);
    grown.take_row(1);
    assert_eq!(grown.get(), faer::mat![[20.0]]);
}

#[test]
fn the_lower_triangle_is_copied_or_averaged() {
    // Sizes within a block of the copy, at its edge and beyond.
    for size in [1, 15, 16, 17, 50] {
        let mut grown = filled(size, size);
        mirror(grown.get_mut());
        let mut averaged = filled(size, size);
        symmetrise(averaged.get_mut());
        for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
            let (low, high) = (i.min(j), i.max(j));
            assert_eq!(grown.get()[(i, j)], (10 * high + low) as f64, "({i}, {j})");
            assert_eq!(averaged.get()[(i, j)], 5.5 * (low + high) as f64, "({i}, {j})");
        }
    }
}
