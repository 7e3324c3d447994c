//! Names of robots in topics.
//!
//! A scenario allows letters, digits, `-` and `_`, after a letter. ROS 2 allows neither `-` nor two consecutive `_`
//! in a topic.

/// Returns each robot's name as part of topics, in the same order. Dashes become underscores, and several
/// underscores become one. If two names then collide, the later one gets a number: `r-1` and `r_1` become `r_1_2`
/// and `r_1`.
pub fn topic_names(names: &[String]) -> Vec<String> {
    let to_topic = |name: &String| -> String {
        let mut topic = String::with_capacity(name.len());
        for character in name.chars() {
            let character = if character == '-' { '_' } else { character };
            if character != '_' || !topic.ends_with('_') {
                topic.push(character);
            }
        }
        topic
    };
    let mut topics: Vec<String> = Vec::with_capacity(names.len());
    for name in names {
        let preferred = to_topic(name);
        // A name that needs no change keeps its spelling in any order.
        let is_taken = |topic: &String| topics.contains(topic) || names.contains(topic);
        let topic = if preferred == *name || !is_taken(&preferred) {
            preferred
        } else {
            let stem = preferred.trim_end_matches('_');
            let numbered = (2..).map(|number| format!("{stem}_{number}"));
            numbered.into_iter().find(|topic| !is_taken(topic)).expect("some number is free")
        };
        topics.push(topic);
    }
    topics
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn topics(names: &[&str]) -> Vec<String> {
        topic_names(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn valid_ros_name_is_unchanged() {
        assert_eq!(topics(&["r1", "Leader_2", "tf"]), ["r1", "Leader_2", "tf"]);
        assert_eq!(topics(&["r-1", "r_1", "r--1"]), ["r_1_2", "r_1", "r_1_3"]);
    }

    proptest! {
        #[test]
        fn every_robot_has_a_distinct_valid_ros_topic(
            names in prop::collection::hash_set("[ab][-_12]{0,4}", 1..30),
        ) {
            let names: Vec<String> = names.into_iter().collect();
            let topics = topic_names(&names);
            for (i, topic) in topics.iter().enumerate() {
                prop_assert!(!topic.contains("__") && !topic.contains('-'), "{}", topic);
                prop_assert!(!topics[..i].contains(topic), "{} twice in {:?}", topic, names);
            }
        }
    }
}
