//! Selection of runs of a campaign by number, as in `1-50,73`.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Ranges of run numbers, which start at 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RunNumbers(Vec<RangeInclusive<usize>>);

impl RunNumbers {
    pub(super) fn contains(&self, number: usize) -> bool {
        self.0.iter().any(|range| range.contains(&number))
    }

    pub(super) fn largest_number(&self) -> usize {
        self.0.iter().map(|range| *range.end()).max().unwrap_or(0)
    }
}

/// Collects increasing numbers into ranges.
impl FromIterator<usize> for RunNumbers {
    fn from_iter<I: IntoIterator<Item = usize>>(numbers: I) -> RunNumbers {
        let mut ranges: Vec<RangeInclusive<usize>> = Vec::new();
        for number in numbers {
            match ranges.last_mut() {
                Some(last) if last.end() + 1 == number => *last = *last.start()..=number,
                _ => ranges.push(number..=number),
            }
        }
        RunNumbers(ranges)
    }
}

impl FromStr for RunNumbers {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<RunNumbers, Self::Err> {
        let range = |part: &str| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (first.parse().ok()?, last.parse().ok()?);
            (0 < first && first <= last).then_some(first..=last)
        };
        let ranges: Option<_> = text.split(',').map(range).collect();
        ranges.map(RunNumbers).ok_or("must be run numbers from 1, as in 1-50,73")
    }
}

impl fmt::Display for RunNumbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, range) in self.0.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            match (range.start(), range.end()) {
                (first, last) if first == last => write!(f, "{comma}{first}")?,
                (first, last) => write!(f, "{comma}{first}-{last}")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_round_trip_through_text() {
        let numbers: RunNumbers = [1, 2, 3, 7, 9, 10].into_iter().collect();
        assert_eq!(numbers.to_string(), "1-3,7,9-10");
        assert_eq!(numbers.to_string().parse(), Ok(numbers.clone()));
        let contained = (0..12).filter(|&number| numbers.contains(number));
        assert_eq!(contained.collect::<Vec<_>>(), [1, 2, 3, 7, 9, 10]);
        assert_eq!(numbers.largest_number(), 10);
        for text in ["", "0", "3-1", "1,", "1-", "a", "1-2-3", "-1"] {
            assert!(text.parse::<RunNumbers>().is_err(), "{text}");
        }
    }
}
