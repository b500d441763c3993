//! Times of frames.

/// Default number of frames per second of a motion.
const PER_SECOND: f64 = 25.0;
/// Maximum default number of frames.
const MOST: f64 = 1000.0;

#[derive(Clone, Debug, PartialEq)]
enum Times {
    /// A scene without motion.
    Still,
    /// Times of recorded poses, s.
    Recorded(Vec<f64>),
    /// First and last time of a motion, s.
    Span([f64; 2]),
}

/// Frame times of a scene.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Timeline {
    times: Times,
    stated: Option<usize>,
}

impl Timeline {
    /// Creates the timeline from the times of a recording that moves probe or needle, or else from the union of all
    /// spans (first and last time, s).
    pub fn new(recorded: Option<Vec<f64>>, spans: &[[f64; 2]], stated: Option<usize>) -> Self {
        let cover = |all: [f64; 2], span: [f64; 2]| [all[0].min(span[0]), all[1].max(span[1])];
        let times = match (recorded, spans.iter().copied().reduce(cover)) {
            (Some(times), _) => Times::Recorded(times),
            (None, Some(span)) if span[1] > span[0] => Times::Span(span),
            _ => Times::Still,
        };
        Self { times, stated }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.stated.unwrap_or_else(|| match &self.times {
            Times::Still => 1,
            Times::Recorded(times) => times.len(),
            Times::Span([start, end]) => ((end - start) * PER_SECOND).ceil().clamp(1.0, MOST - 1.0) as usize + 1,
        })
    }

    /// Time of the first frame, s.
    pub fn start_s(&self) -> f64 {
        match &self.times {
            Times::Still => 0.0,
            Times::Recorded(times) => times.first().copied().unwrap_or_default(),
            Times::Span([start, _]) => *start,
        }
    }

    /// Time of frame `frame` of `of`, s.
    pub fn time_s(&self, frame: usize, of: usize) -> f64 {
        let [start, end] = match &self.times {
            Times::Still => return 0.0,
            Times::Recorded(times) if times.len() == of => return times[frame.min(of - 1)],
            Times::Recorded(times) => [self.start_s(), times.last().copied().unwrap_or_default()],
            Times::Span(span) => *span,
        };
        let share = (frame as f64 / of.saturating_sub(1).max(1) as f64).min(1.0);
        start * (1.0 - share) + end * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_keep_their_times_and_motions_are_spread() {
        let recorded = Timeline::new(Some(vec![5.0, 5.1, 7.0]), &[[0.0, 99.0]], None);
        assert_eq!(recorded.frames(), 3);
        assert_eq!([0, 1, 2].map(|frame| recorded.time_s(frame, 3)), [5.0, 5.1, 7.0]);
        assert_eq!([0, 1].map(|frame| recorded.time_s(frame, 2)), [5.0, 7.0]);
        let span = Timeline::new(None, &[[1.0, 2.0], [0.0, 1.5]], None);
        assert_eq!((span.frames(), span.start_s()), (51, 0.0));
        assert_eq!([0, 1, 2].map(|frame| span.time_s(frame, 3)), [0.0, 1.0, 2.0]);
        assert_eq!(Timeline::new(None, &[[0.0, 1e9]], None).frames(), 1000);
    }

    #[test]
    fn nothing_moves_at_time_nought() {
        let still = Timeline::new(None, &[[3.0, 3.0]], Some(4));
        assert_eq!((still.frames(), still.time_s(3, 4), still.start_s()), (4, 0.0, 0.0));
        assert_eq!(Timeline::new(None, &[], None).frames(), 1);
    }
}
