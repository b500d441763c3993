use super::contender::Step;
use super::subject::generated;
use super::*;
use faer::{Mat, MatRef};

use crate::StudyError;
use insonify_base::range::OutOfRange;
use insonify_mechanics::tissue::remesh::{AdaptedMesh, Change};

fn options() -> RemeshOptions {
    RemeshOptions {
        moves: 6,
        updates: 30,
        ..RemeshOptions::default()
    }
}

fn small() -> TetMesh {
    generated(400).unwrap()
}

#[test]
fn every_level_is_measured_and_keeps_what_it_promises() {
    let mut shares = Vec::new();
    let study = study(&[small()], &[], &options(), &mut |_, share| shares.push(share)).unwrap();
    assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{shares:?}");
    let table = &study.tables[0];
    assert_eq!(
        table.rows.len(),
        12,
        "five levels twice, columns on demand, refactorisation"
    );
    let value =
        |row: &crate::tradeoff::Row, key: &str| row.values[table.axes.iter().position(|axis| axis.key == key).unwrap()];
    for row in &table.rows {
        assert_eq!(row.flag, None, "{row:?}");
        assert_eq!(value(row, "updates"), Some(30.0));
        let error = value(row, "error_condensed").unwrap();
        let level = row.choices[1].as_str();
        // Levels II, III and IV leave entries outdated, and the needle moves its own contacts: the error is large.
        if ["II", "III", "IV"].contains(&level) {
            assert!(error > 1e-4, "{row:?}");
        } else {
            let limit = if row.choices[3] == "f64" { 1e-9 } else { 1e-2 };
            assert!(error < limit, "{row:?}");
        }
    }
    assert!(table.best().contains(&true));
    // Each state of the first insertion, and 10 and 30 updates, for each row.
    let drift = &study.tables[1];
    let states = drift.rows.len() / table.rows.len();
    assert!(states >= 3 + 2, "{states} states");
    for (row, row_of_table) in drift.rows.chunks(states).zip(&table.rows) {
        assert!(row.iter().all(|row| row.choices == row_of_table.choices));
        let updates: Vec<f64> = row.iter().filter_map(|row| row.values[0]).collect();
        assert!(updates.is_sorted() && updates[..3] == [1.0, 2.0, 3.0], "{updates:?}");
        assert_eq!(updates[states - 2..], [10.0, 30.0]);
    }
    assert!(study.notes.is_empty(), "{:?}", study.notes);
}

/// Returns a ball with approximately the given number of nodes, 40 mm in radius.
fn ball(nodes: usize) -> TetMesh {
    let cube = TetMesh::over_box([-40.0; 3], [40.0; 3], nodes).unwrap();
    let round = cube.nodes().iter().map(|position| {
        let [x, y, z] = *position;
        let farthest = x.abs().max(y.abs()).max(z.abs());
        position.map(|coordinate| coordinate * farthest / (x * x + y * y + z * z).sqrt().max(1e-9))
    });
    TetMesh::new(round.collect(), cube.elements().to_vec(), cube.regions().to_vec()).unwrap()
}

/// Supported only in its lowest 2 %, it would rotate almost freely about a few nodes.
#[test]
fn a_round_mesh_is_held_well_and_followed() {
    let ball = ball(500);
    let subject = Subject::new(&ball, &options()).unwrap();
    assert!(
        subject.fixed() * 100 >= 3 * subject.nodes(),
        "{} fixed",
        subject.fixed()
    );
    let study = study(&[ball], &[], &options(), &mut |_, _| {}).unwrap();
    println!("{}", study.text());
    let flagged = study.tables[0].rows.iter().filter(|row| row.flag.is_some()).count();
    assert_eq!((flagged, study.notes.len()), (0, 0), "{}", study.text());
}

/// A rod 50 times as long as wide is extremely compliant: in f32 the exact level lacks an accurate base and reports so.
#[test]
fn an_exact_level_refuses_a_base_that_is_barely_held() {
    let rod = TetMesh::over_box([0.0; 3], [30.0, 30.0, 1600.0], 1000).unwrap();
    let subject = Subject::new(&rod, &options()).unwrap();
    let double = Arc::new(invert::<f64>(&subject.factor, &mut |_, _| {}).unwrap());
    let sources = Sources {
        single: Source::Single(Arc::new(double.cast())),
        double: Source::Double(double),
    };
    let make =
        |precision| Kind::Dense(insonify_mechanics::tissue::remesh::Level::Exact, precision).make(&subject, &sources);
    let refused = make(insonify_mechanics::tissue::remesh::Precision::Single).err();
    let refused = refused.expect("f32 is no base").to_string();
    assert!(refused.contains("hold more of the mesh"), "{refused}");
    assert!(make(insonify_mechanics::tissue::remesh::Precision::Double).is_ok());
}

/// Contender that follows exactly, except for an error too large for rounding.
struct Wrong {
    truth: Box<dyn Contender>,
    deviation: f64,
    condensed: Mat<f64>,
}

impl Contender for Wrong {
    fn limit(&self) -> Option<f64> {
        self.truth.limit()
    }

    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), Error> {
        self.truth.set_contacts(dofs)
    }

    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<Step, Error> {
        let step = self.truth.remesh(mesh, change)?;
        self.condensed = self.truth.condensed().to_owned();
        self.condensed[(0, 0)] *= 1.0 + self.deviation;
        Ok(step)
    }

    fn condensed(&self) -> MatRef<'_, f64> {
        self.condensed.as_ref()
    }

    fn block(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, Error> {
        self.truth.block(rows, columns)
    }

    fn memory_bytes(&self) -> usize {
        self.truth.memory_bytes()
    }

    fn displacement(&mut self, forces: &[f64], displacement_mm: &mut [f64]) -> Result<(), Error> {
        self.truth.displacement(forces, displacement_mm)
    }
}

#[test]
fn a_level_that_is_wrong_is_flagged_by_its_error() {
    let options = options();
    let subject = Subject::new(&small(), &options).unwrap();
    let truth = Truth::new(&subject, &options).unwrap();
    let double = Arc::new(invert::<f64>(&subject.factor, &mut |_, _| {}).unwrap());
    let sources = Sources {
        single: Source::Single(Arc::new(double.cast())),
        double: Source::Double(double),
    };
    let exact = Kind::Dense(
        insonify_mechanics::tissue::remesh::Level::Exact,
        insonify_mechanics::tissue::remesh::Precision::Double,
    );
    for (deviation, flagged) in [(0.0, false), (1e-5, true), (f64::NAN, true)] {
        let mut contender = Wrong {
            truth: exact.make(&subject, &sources).unwrap(),
            deviation,
            condensed: Mat::new(),
        };
        let measured = measure(&mut contender, &subject, &truth, &options);
        let error = measured.errors.map_or(f64::NAN, |errors| errors[1]);
        assert!(
            deviation.is_nan() || (error <= 1e-9) == (deviation == 0.0),
            "off by {deviation}: {error}"
        );
        assert_eq!(
            measured.flag.is_some(),
            flagged,
            "off by {deviation}: {:?}",
            measured.flag
        );
    }
}

#[test]
fn memory_is_checked_first_and_unsuited_meshes_are_errors() {
    let refused = check_memory(30_000, &[], Some(1 << 30)).unwrap_err();
    let Some(StudyError::Memory {
        what: buffer,
        needed,
        available,
    }) = refused.downcast_ref()
    else {
        panic!("{refused}")
    };
    assert!(buffer.contains("30000") && *available == 1 << 30, "{buffer}");
    assert!(*needed > 2 * Symmetric::<f64>::bytes_of(30_000));
    assert!(check_memory(3000, &[], Some(1 << 30)).is_ok());
    assert!(check_memory(30_000, &[], None).is_ok());

    let tiny = TetMesh::over_box([0.0; 3], [1.0; 3], 27).unwrap();
    let refused = Subject::new(&tiny, &options()).err().expect("27 nodes are too few");
    assert!(refused.to_string().contains("expected"), "{refused}");
    let invalid = RemeshOptions {
        poisson: 0.5,
        ..options()
    };
    let refused = Subject::new(&small(), &invalid).err();
    assert!(refused.is_some_and(|error| error.downcast_ref::<OutOfRange>().is_some()));
    // f32 is insufficient near incompressibility: reported, not measured.
    let nearly = RemeshOptions {
        poisson: 0.499,
        ..options()
    };
    let study = study(&[small()], &[], &nearly, &mut |_, _| {}).unwrap();
    assert!(
        study
            .notes
            .iter()
            .any(|note| note.contains("0.499") && note.contains("not measured")),
        "{:?}",
        study.notes
    );
}

#[test]
fn an_insertion_moves_each_node_once_and_a_withdrawal_restores_all() {
    let options = options();
    let subject = Subject::new(&small(), &options).unwrap();
    let mut mesh = subject.mesh.clone();
    for done in 0..2 * subject.inserted() {
        subject.step(&mut mesh, done).unwrap();
        let nodes_away = (done + 1).min(2 * subject.inserted() - done - 1);
        assert_eq!(mesh.away().len(), nodes_away);
    }
    assert_eq!(mesh.nodes(), subject.mesh.nodes());
}

/// Runs the exact level with an error too large for rounding.
fn offset(deviation: f64) -> Result<Study, Error> {
    let options = options();
    let subjects = [Subject::new(&small(), &options)?];
    let subject = &subjects[0];
    let truth = Truth::new(subject, &options)?;
    let double = Arc::new(invert::<f64>(&subject.factor, &mut |_, _| {})?);
    let sources = Sources {
        single: Source::Single(Arc::new(double.cast())),
        double: Source::Double(double),
    };
    let mut report = RemeshReport::new(&subjects, &[], &options)?;
    let kind = Kind::OnDemand;
    let mut contender = Wrong {
        truth: kind.make(subject, &sources)?,
        deviation,
        condensed: Mat::new(),
    };
    let measured = measure(&mut contender, subject, &truth, &options);
    report.add(subject, &kind, contender.limit().is_some(), measured);
    Ok(report.finish())
}

#[test]
fn a_level_seeded_with_an_offset_is_flagged_in_the_report_of_all_studies() {
    use crate::tradeoff::entry::Context;
    use crate::tradeoff::gather::gather;
    type Run = fn(&RemeshSettings, Context<'_>) -> Result<Study, Error>;
    let report = |run: Run| {
        let entry = Entry { run, ..ENTRY };
        gather(
            &[&entry],
            &Devices::default(),
            Effort::Quick,
            crate::tradeoff::Rates::default(),
            &mut |_, _| {},
        )
    };
    let (right_report, wrong_report) = (report(|_, _| offset(0.0)), report(|_, _| offset(1e-5)));
    assert_eq!(
        (right_report.wrong().count(), wrong_report.wrong().count()),
        (0, 1),
        "{:?}",
        wrong_report.missing
    );
    let (_, _, row) = wrong_report.wrong().next().unwrap();
    assert!(
        row.flag.as_ref().unwrap().contains("expected of an exact level")
            && row.choices.contains(&"exact, columns on demand".to_owned())
    );
    let page = wrong_report.page().unwrap();
    assert!(page.contains("WRONG: K") && !right_report.page().unwrap().contains("WRONG"));
    assert_eq!(
        wrong_report.chapters[0].study.tables[0].advice()[0].take,
        None,
        "it is never advised"
    );
}
