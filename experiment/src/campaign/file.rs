//! Parser of campaign files, with the same diagnostics as for scenarios. `cells` checks that each run is valid.

use std::path::{Path, PathBuf};

pub use crate::campaign::keys::FileRetention;
use crate::scenario::diagnostic::{Diagnostic, SourceText};
use crate::scenario::fields::kinds;
use crate::scenario::file::load_text;
use crate::scenario::format::{FileFormat, ValueType};
use crate::scenario::read::{external_laws, parse_toml};
use crate::scenario::table::{Document, TableReader, TypedValue, format_as_toml};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use toml::de::DeValue;

use crate::campaign::axes::{Axis, AxisKind, Case, Setting, parse_axis};
use crate::campaign::keys;
use crate::campaign::starts::RandomStarts;

/// Maximum number of runs of a campaign. More are assumed to be a typing error.
const RUNS_MAX: usize = 1_000_000;

/// Parameter study: many runs of one scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Campaign {
    /// Name of the campaign.
    pub name: String,
    /// Path of the campaign file.
    pub path: PathBuf,
    /// Path of the scenario file.
    pub scenario: PathBuf,
    /// Scenario keys that all runs set, in the syntax of `--set`.
    pub assignments: Vec<String>,
    /// Axes: the parameters that vary.
    pub axes: Vec<Axis>,
    /// Groups of axes that vary together, by index. Each axis is in exactly one group.
    pub axis_groups: Vec<Vec<usize>>,
    /// Faults of all runs. Names of axes in braces are replaced by their values.
    pub faults: Vec<String>,
    /// Seeds of each point of the grid. If empty, one run with the seed of the scenario.
    pub seeds: Vec<u64>,
    /// Random starts. `None`: those of the scenario.
    pub random_starts: Option<RandomStarts>,
    /// Time mode.
    pub pace: Pace,
    /// Files that are kept of each run.
    pub file_retention: FileRetention,
    /// Maximum wall time of a run, s.
    pub deadline_s: f64,
}

impl Campaign {
    /// Returns the number of points of the grid.
    pub fn point_count(&self) -> usize {
        self.axis_groups.iter().map(|group| self.axes[group[0]].settings.len()).product()
    }

    /// Returns the number of runs of each point of the grid: one for each seed, or one with the seed of the scenario.
    pub fn runs_per_point(&self) -> usize {
        self.seeds.len().max(1)
    }

    /// Returns the number of runs.
    pub fn run_count(&self) -> usize {
        self.point_count().saturating_mul(self.runs_per_point())
    }

    /// Returns the value of each axis at a point of the grid. The first group varies most slowly.
    pub fn settings_at(&self, point: usize) -> Vec<&Setting> {
        let mut settings: Vec<Option<&Setting>> = vec![None; self.axes.len()];
        let mut rest = point;
        for group in self.axis_groups.iter().rev() {
            let length = self.axes[group[0]].settings.len();
            for &axis in group {
                settings[axis] = Some(&self.axes[axis].settings[rest % length]);
            }
            rest /= length;
        }
        settings.into_iter().map(|setting| setting.expect("each axis is in a group")).collect()
    }
}

/// Parses a campaign file. `catalog` has the known control laws and avoidance methods.
///
/// # Errors
///
/// The first mistake in the file, or the reason why it cannot be read.
pub fn read(path: &Path, catalog: &Catalog) -> Result<Campaign, Diagnostic> {
    let expected = "expected a campaign file, such as scenarios/campaigns/triangle-starts.toml";
    let file_error = |problem: String| {
        Diagnostic::without_location(format!("`{}` {problem}", path.display()), expected)
    };
    let text = load_text(path, expected).map_err(|error| file_error(error.problem))?;
    read_text(path, &text, catalog)
}

/// Parses the text of a campaign file. `path` is only used in messages.
pub fn read_text(path: &Path, text: &str, catalog: &Catalog) -> Result<Campaign, Diagnostic> {
    let source = SourceText::new(path, text, false);
    let entries = parse_toml(text, &source)?;
    let format = keys::campaign_format();
    let document = Document::new(source, &format);
    let root: TableReader<'_, keys::Root> =
        TableReader::root(&document, entries.get_ref(), "the campaign");
    root.check_keys()?;

    let name = root.required_value(keys::Root::name)?;
    let name_text = name.text("expected a string")?;
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name_text.is_empty() || name_text.starts_with('.') || !name_text.chars().all(is_allowed) {
        let expected = "expected letters, digits, `-`, `_` or `.`: it is also the name of a folder";
        return Err(name.error_about_key(format!("is \"{name_text}\""), expected));
    }
    if let Some(description) = root.get(keys::Root::description) {
        description.text("expected a string")?;
    }
    let scenario = root.required_value(keys::Root::scenario)?;
    let file = parse_scenario_path(path, &scenario)?;
    let scenario_format = scenario_format(&root, path, &file, catalog)?;

    let templates = parse_faults(root.get(keys::Root::faults))?;
    let set = parse_assignments(root.get(keys::Root::set), &scenario_format)?;
    let mut axes = parse_case_axes(&root, path, &scenario_format)?;
    for (key, value) in leaf_entries(root.get(keys::Root::vary), true)? {
        let placeholder = format!("{{{key}}}");
        let kind = match &*key {
            "fault" => AxisKind::Fault,
            "seed" => {
                return Err(value.error_at_value(
                    "`seed` is no axis",
                    "expected `seeds`, outside of all tables: the seeds with which each combination of settings is run",
                ));
            }
            _ if templates.iter().any(|fault| fault.contains(&placeholder)) => {
                AxisKind::FaultPlaceholder
            }
            _ => {
                check_dotted_key(&key, &value, &scenario_format)?;
                AxisKind::Key
            }
        };
        if axes.iter().any(|axis| axis.key == key) {
            let expected = "expected another name for one of them";
            return Err(value.error_at_value(format!("`{key}` is an axis of cases too"), expected));
        }
        axes.push(parse_axis(&key, kind, &value)?);
    }
    for fault in &templates {
        let Some((_, rest)) = fault.split_once('{') else { continue };
        let inner = rest.split('}').next().unwrap_or(rest);
        if !axes.iter().any(|axis: &Axis| axis.key == inner) {
            let list = root.required_value(keys::Root::faults)?;
            let expected = format!("expected an axis `{inner}` in [vary], a list of its values");
            return Err(
                list.error_about_key(format!("has `{{{inner}}}`, which is no axis"), expected)
            );
        }
    }
    let groups = parse_axis_groups(&root, &axes)?;
    let campaign = Campaign {
        name: name_text.to_owned(),
        path: path.to_owned(),
        scenario: file,
        assignments: set,
        axes,
        axis_groups: groups,
        faults: templates,
        seeds: root.get(keys::Root::seeds).map_or(Ok(Vec::new()), |value| parse_seeds(&value))?,
        random_starts: root
            .get(keys::Root::starts)
            .map(|value| RandomStarts::read(&value))
            .transpose()?,
        pace: root.read_word(keys::Root::pace)?,
        file_retention: root.read_word(keys::Root::keep)?,
        deadline_s: root.number(keys::Root::deadline_s)?,
    };
    check_seeds_and_size(&campaign, &root)?;
    Ok(campaign)
}

/// Checks that drawn starts have seeds, and that the campaign has at most [`RUNS_MAX`] runs.
fn check_seeds_and_size(
    campaign: &Campaign,
    root: &TableReader<'_, keys::Root>,
) -> Result<(), Diagnostic> {
    let drawn = |setting: &Setting| setting.case.random_starts.is_some();
    let drawn = campaign.axes.iter().flat_map(|axis| &axis.settings).any(drawn);
    if (campaign.random_starts.is_some() || drawn) && campaign.seeds.is_empty() {
        return Err(root.missing_key_error(
            keys::Root::seeds,
            "number of seeds from which starts are drawn, such as 100",
        ));
    }
    let runs = campaign.run_count();
    if runs > RUNS_MAX {
        let expected = format!("expected at most {RUNS_MAX} runs");
        let message = format!("the campaign has {runs} runs");
        let largest = [
            root.get(keys::Root::vary).map(|vary| vary.error_at_value(&message, &expected)),
            root.get(keys::Root::seeds).map(|seeds| seeds.error_at_value(&message, &expected)),
            root.get(keys::Root::case).map(|cases| cases.error_at_value(&message, &expected)),
        ];
        return Err(largest.into_iter().flatten().next().expect("one of them is long"));
    }
    Ok(())
}

/// Returns the path of the scenario file that a key names, relative to the campaign file at `path`.
fn parse_scenario_path(
    path: &Path,
    scenario: &TypedValue<'_, kinds::Text>,
) -> Result<PathBuf, Diagnostic> {
    let expected = "expected a scenario file, such as \"../scenarios/triangle.toml\"";
    let file = path.parent().unwrap_or(Path::new("")).join(scenario.text(expected)?);
    load_text(&file, expected).map_err(|error| {
        scenario.error_about_key(
            format!("names `{}`, which {}", file.display(), error.problem),
            expected,
        )
    })?;
    Ok(file)
}

/// Returns the format of the scenario at `file`, and of those of the cases, with the gains of their own laws.
fn scenario_format(
    root: &TableReader<'_, keys::Root>,
    path: &Path,
    file: &Path,
    catalog: &Catalog,
) -> Result<FileFormat, Diagnostic> {
    let mut known = Catalog { laws: external_laws(file, catalog), ..catalog.clone() };
    for case in root.tables(keys::Root::case)? {
        if let Some(scenario) = case.get(keys::Case::scenario) {
            known.laws.extend(external_laws(&parse_scenario_path(path, &scenario)?, catalog));
        }
    }
    known.laws.extend_from_slice(&catalog.laws);
    Ok(FileFormat::new(&known))
}

/// Parses a list of faults in the syntax of `--fault`.
fn parse_faults(list: Option<TypedValue<'_, kinds::Any>>) -> Result<Vec<String>, Diagnostic> {
    let expected = "expected a list of faults, such as [\"kill r2 @10\"]";
    list.map_or(Ok(Vec::new()), |list| list.texts(expected))
}

/// Returns the scenario keys that a table `set` sets, in the syntax of `--set`.
fn parse_assignments(
    table: Option<TypedValue<'_, kinds::Table<keys::Set>>>,
    format: &FileFormat,
) -> Result<Vec<String>, Diagnostic> {
    let assignment = |(key, value): (String, TypedValue<'_, _>)| {
        check_dotted_key(&key, &value, format)?;
        Ok(format!("{key}={}", format_as_toml(value.toml_value())))
    };
    leaf_entries(table, false)?.into_iter().map(assignment).collect()
}

/// Returns the axes that `[[case]]` tables define, in the order of the first case of each.
fn parse_case_axes(
    root: &TableReader<'_, keys::Root>,
    path: &Path,
    format: &FileFormat,
) -> Result<Vec<Axis>, Diagnostic> {
    let mut axes: Vec<Axis> = Vec::new();
    for table in root.tables(keys::Root::case)? {
        table.check_keys()?;
        let (axis, name) =
            (table.required_value(keys::Case::axis)?, table.required_value(keys::Case::name)?);
        let key = axis.text("expected a string")?;
        let display_text = name.text("expected a string")?.to_owned();
        let faults = parse_faults(table.get(keys::Case::faults))?;
        let scenario = table
            .get(keys::Case::scenario)
            .map(|value| parse_scenario_path(path, &value))
            .transpose()?;
        let starts =
            table.get(keys::Case::starts).map(|value| RandomStarts::read(&value)).transpose()?;
        let case = Case {
            scenario,
            assignments: parse_assignments(table.get(keys::Case::set), format)?,
            random_starts: starts,
        };
        let setting =
            Setting { toml: display_text.clone(), display_text, numeric_value: None, faults, case };
        let index = axes.iter().position(|axis| axis.key == key).unwrap_or(axes.len());
        if index == axes.len() {
            let key = key.to_owned();
            axes.push(Axis { key, kind: AxisKind::Cases, settings: Vec::new() });
        }
        if axes[index].settings.iter().any(|other| other.display_text == setting.display_text) {
            let message =
                format!("is \"{}\", which the axis `{key}` has already", setting.display_text);
            return Err(name.error_about_key(message, "expected each value once"));
        }
        axes[index].settings.push(setting);
    }
    Ok(axes)
}

/// Returns the scenario keys of a table as dotted paths with their values. A nested table is a part of the path unless
/// it is a range, and the table may have `ranges`.
fn leaf_entries<'t, T>(
    table: Option<TypedValue<'t, T>>,
    ranges: bool,
) -> Result<Vec<(String, TypedValue<'t, T>)>, Diagnostic> {
    let Some(value) = table else { return Ok(Vec::new()) };
    let mut found = Vec::new();
    collect_leaf_entries(&value, "", ranges, &mut found)?;
    // In file order. The table itself is sorted by name.
    found.sort_by_key(|(_, value)| value.span().start);
    Ok(found)
}

fn collect_leaf_entries<'t, T>(
    value: &TypedValue<'t, T>,
    prefix: &str,
    ranges: bool,
    found: &mut Vec<(String, TypedValue<'t, T>)>,
) -> Result<(), Diagnostic> {
    let entries = value.entries("expected a table of keys of the scenario")?;
    for (key, inner) in entries {
        // An edge is `FROM->TO`.
        let plain = key.replacen("->", "", 1);
        let is_valid = !plain.is_empty()
            && plain.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-' || c == '.');
        if !is_valid {
            let expected = "expected a key as in `--set`: avoidance.kind";
            return Err(inner.error_at_value(format!("`{key}` is not a key"), expected));
        }
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        let inner = inner.with_name(&path);
        match inner.toml_value() {
            // An empty table is a value: it removes the table of the scenario.
            DeValue::Table(table) if table.is_empty() => found.push((path, inner)),
            DeValue::Table(table) if !(ranges && table.contains_key("from")) => {
                collect_leaf_entries(&inner, &path, ranges, found)?;
            }
            _ => found.push((path, inner)),
        }
    }
    Ok(())
}

/// Returns whether the value is an empty list.
fn is_empty_list<T>(value: &TypedValue<'_, T>) -> bool {
    matches!(value.toml_value(), DeValue::Array(elements) if elements.is_empty())
}

/// Returns an error for a dotted key that does not exist in scenarios.
fn check_dotted_key<T>(
    path: &str,
    value: &TypedValue<'_, T>,
    format: &FileFormat,
) -> Result<(), Diagnostic> {
    let mut section = format.root();
    let mut parts = path.split('.');
    while let Some(part) = parts.next() {
        let Some(key) = section.find_key(part) else {
            let rows: Vec<_> = section.keys.iter().collect();
            let expected = format.unknown_key_remedy(section, &rows, part, true);
            return Err(value.error_at_value(format!("a scenario has no key `{path}`"), expected));
        };
        match key.value_type {
            ValueType::Table(name) | ValueType::FileOrTable(name) => section = format.section(name),
            ValueType::NamedTables(name) => {
                section = format.section(name);
                if parts.next().is_none() {
                    let expected = format!("expected the name of one: {part}.NAME.KEY");
                    return Err(value.error_at_value(format!("`{part}` has tables"), expected));
                }
            }
            ValueType::Tables(name) if name == "robot" => {
                section = format.section(name);
                if parts.next().is_none() {
                    let expected = "expected the name of one: robot.r1.law";
                    return Err(value.error_at_value("`robot` is a list of robots", expected));
                }
            }
            ValueType::Tables(name @ "edge") if path.contains("->") => {
                section = format.section(name);
                parts.next();
            }
            ValueType::Tables(_) if is_empty_list(value) && parts.next().is_none() => {
                return Ok(());
            }
            ValueType::Tables(_) => {
                let expected = "expected `faults`, or `fault` in [vary]; of an edge, expected edge.\"r1->r2\".KEY";
                return Err(value.error_at_value(format!("`{path}` is a list of tables"), expected));
            }
            ValueType::Any(_) => return Ok(()),
            _ if parts.clone().next().is_some() => {
                let expected = format!("expected `{part}` alone");
                return Err(value.error_at_value(format!("`{part}` is no table"), expected));
            }
            _ => return Ok(()),
        }
    }
    Ok(())
}

/// Returns the groups of axes that vary together. Other axes are groups of one.
fn parse_axis_groups(
    root: &TableReader<'_, keys::Root>,
    axes: &[Axis],
) -> Result<Vec<Vec<usize>>, Diagnostic> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    if let Some(zip) = root.get(keys::Root::zip) {
        let expected = "expected a list of lists of axes: [[\"period_s\", \"duration_s\"]]";
        for list in zip.elements(expected)? {
            let mut group: Vec<usize> = Vec::new();
            for name in list.elements(expected)? {
                let text = name.text(expected)?;
                let Some(axis) = axes.iter().position(|axis| axis.key == text) else {
                    let names: Vec<&str> = axes.iter().map(|axis| axis.key.as_str()).collect();
                    let expected = format!("expected one of {}", names.join(", "));
                    return Err(
                        name.error_at_value(format!("`{text}` is no axis of [vary]"), expected)
                    );
                };
                if groups.iter().flatten().chain(&group).any(|&other| other == axis) {
                    let expected = "expected each axis once";
                    return Err(
                        name.error_at_value(format!("`{text}` is in `zip` twice"), expected)
                    );
                }
                if let Some(&first) = group.first() {
                    let [long, other] = [first, axis].map(|axis| axes[axis].settings.len());
                    if long != other {
                        let first = &axes[first].key;
                        let message = format!("`{text}` has {other} values, `{first}` has {long}");
                        let expected = "expected the same number of values: the axes vary together";
                        return Err(name.error_at_value(message, expected));
                    }
                }
                group.push(axis);
            }
            if group.is_empty() {
                return Err(list.error_about_key("is empty", expected));
            }
            groups.push(group);
        }
    }
    for axis in 0..axes.len() {
        if !groups.iter().flatten().any(|&other| other == axis) {
            groups.push(vec![axis]);
        }
    }
    // In axis order: the first varies most slowly.
    groups.sort_by_key(|group| group.iter().copied().min());
    Ok(groups)
}

fn parse_seeds(value: &TypedValue<'_, kinds::Any>) -> Result<Vec<u64>, Diagnostic> {
    let expected = "expected how many seeds there are, a list of them, or { from, count }";
    let parse_integer =
        |value: &TypedValue<'_, kinds::Any>, minimum: u64| -> Result<u64, Diagnostic> {
            let number = match value.toml_value() {
                DeValue::Integer(integer) => {
                    u64::from_str_radix(integer.as_str(), integer.radix()).ok()
                }
                _ => return Err(value.wrong_type_error(expected)),
            };
            let valid = number.filter(|number| (minimum..=i64::MAX as u64).contains(number));
            valid.ok_or_else(|| {
                value.error_about_key("is out of range", format!("expected {minimum} or more"))
            })
        };
    let consecutive_seeds =
        |from: u64, count: u64, location: &TypedValue<'_, kinds::Any>| match count as usize
            <= RUNS_MAX
        {
            true => Ok((from..from.saturating_add(count)).collect()),
            false => Err(location.error_about_key(
                format!("requests {count}"),
                format!("expected at most {RUNS_MAX}"),
            )),
        };
    match value.toml_value() {
        DeValue::Integer(_) => consecutive_seeds(1, parse_integer(value, 1)?, value),
        DeValue::Array(_) => {
            let mut seeds = Vec::new();
            for seed in value.elements(expected)? {
                let number = parse_integer(&seed, 0)?;
                if seeds.contains(&number) {
                    return Err(seed
                        .error_about_key(format!("is {number} again"), "expected each seed once"));
                }
                seeds.push(number);
            }
            match seeds.is_empty() {
                true => Err(value.error_about_key("is empty", expected)),
                false => Ok(seeds),
            }
        }
        DeValue::Table(_) => {
            let (mut from, mut count) = (1, None);
            for (key, inner) in value.entries(expected)? {
                match &*key {
                    "from" => from = parse_integer(&inner, 0)?,
                    "count" => count = Some(parse_integer(&inner, 1)?),
                    _ => {
                        let message = format!("`seeds` has no key `{key}`");
                        return Err(inner.error_at_value(message, "expected `from` and `count`"));
                    }
                }
            }
            let expected = "expected how many seeds";
            consecutive_seeds(
                from,
                count.ok_or_else(|| value.error_about_key("has no `count`", expected))?,
                value,
            )
        }
        _ => Err(value.wrong_type_error(expected)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EMPTY_CATALOG: Catalog = Catalog { laws: Vec::new(), methods: Vec::new() };

    fn parse_campaign(text: &str) -> Campaign {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/campaign.toml");
        let text = format!("name = 'a'\nscenario = '../../scenarios/triangle.toml'\n{text}");
        read_text(&path, &text, &EMPTY_CATALOG)
            .unwrap_or_else(|error| panic!("{}", error.render(false)))
    }

    #[test]
    fn grid_has_every_combination_once_first_axis_slowest() {
        let campaign = parse_campaign(
            "zip = [['hung_after_s', 'period_s']]\n[vary]\nperiod_s = [1, 2]\nrecord_hz = [3, 4, 5]\n\
             hung_after_s = [6, 7]\n",
        );
        let display_texts = |point| {
            campaign.settings_at(point).iter().map(|s| s.display_text.clone()).collect::<Vec<_>>()
        };
        let points: Vec<_> =
            (0..campaign.point_count()).map(|point| display_texts(point).join(" ")).collect();
        assert_eq!(points, ["1 3 6", "1 4 6", "1 5 6", "2 3 7", "2 4 7", "2 5 7"]);
    }

    #[test]
    fn dotted_keys_and_tables_in_tables_are_the_same_axes() {
        let dotted = parse_campaign("[vary]\nchaos.from_s = [1, 2]\nrobot.r1.pose.x_m = [0.5]\n");
        let tables = parse_campaign(
            "vary = { chaos = { from_s = [1, 2] }, robot = { r1 = { pose = { x_m = [0.5] } } } }",
        );
        assert_eq!(dotted.axes, tables.axes);
        assert_eq!(dotted.axes[1].key, "robot.r1.pose.x_m");
        let range = parse_campaign("[vary]\nchaos.from_s = { from = 1, to = 2, count = 3 }\n");
        let numbers: Vec<_> =
            range.axes[0].settings.iter().filter_map(|s| s.numeric_value).collect();
        assert_eq!(numbers, [1.0, 1.5, 2.0]);
    }

    #[test]
    fn parameters_of_laws_robots_and_edges_are_axes() {
        let campaign = parse_campaign(
            "[vary]\nlaws.mine.params.w = [1, 2]\nrobot.r1.params.goals_m = [[[0.0, 1.0]]]\n\
             edge.\"r1->r2\".params.weight = [0.5]\n",
        );
        let keys: Vec<&str> = campaign.axes.iter().map(|axis| axis.key.as_str()).collect();
        let [law, robot, edge] = keys[..] else { panic!("{keys:?}") };
        assert_eq!((law, robot), ("laws.mine.params.w", "robot.r1.params.goals_m"));
        assert_eq!(edge, "edge.r1->r2.params.weight");
    }

    #[test]
    fn cases_make_axes_that_change_slower_than_others() {
        let campaign = parse_campaign(
            "case = [{ axis = 'scene', name = 'a' }, { axis = 'condition', name = 'ideal' },\n\
             { axis = 'scene', name = 'b', scenario = '../../scenarios/line-5.toml' },\n\
             { axis = 'condition', name = 'late', set = { period_s = 0.02 }, faults = ['x'] }]\n\
             [vary]\nrecord_hz = [3, 4]\n",
        );
        let keys: Vec<&str> = campaign.axes.iter().map(|axis| axis.key.as_str()).collect();
        assert_eq!((keys, campaign.point_count()), (vec!["scene", "condition", "record_hz"], 8));
        let [scene, condition, _] = campaign.settings_at(6)[..] else { panic!("three axes") };
        assert!(scene.case.scenario.as_ref().unwrap().ends_with("scenarios/line-5.toml"));
        assert_eq!(
            (&condition.case.assignments[..], &condition.faults[..]),
            (&["period_s=0.02".to_owned()][..], &["x".to_owned()][..],)
        );
    }

    #[test]
    fn empty_table_or_list_removes_the_scenario_entries() {
        let set = |text: &str| parse_campaign(&format!("[set]\n{text}")).assignments;
        assert_eq!(set("expect = {}\nfault = []\n"), ["expect={}", "fault=[]"]);
        assert_eq!(set("expect = { min_distance_m = 0.3 }\n"), ["expect.min_distance_m=0.3"]);
    }

    #[test]
    fn seeds_are_a_number_a_list_or_a_stretch() {
        assert_eq!(parse_campaign("seeds = 3").seeds, [1, 2, 3]);
        assert_eq!(parse_campaign("seeds = [7, 2]").seeds, [7, 2]);
        assert_eq!(parse_campaign("seeds = { from = 5, count = 2 }").seeds, [5, 6]);
        assert!(parse_campaign("").seeds.is_empty());
    }
}
