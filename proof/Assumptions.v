(** List of the axioms on which the theorems rest in addition to their hypotheses: those of Coq's real numbers. The
    check compares this output with `axioms.txt`. *)

From Phalanx Require Import Promise Braking Obstacles Walls Team.

Print Assumptions no_two_robots_are_ever_nearer_than_d.
Print Assumptions no_two_braking_robots_are_ever_nearer_than_d.
Print Assumptions no_braking_robot_comes_nearer_to_an_obstacle.
Print Assumptions no_robot_that_stops_at_once_comes_nearer_to_an_obstacle.
Print Assumptions a_team_keeps_its_distances.
Print Assumptions a_mixed_team_keeps_its_distances.
Print Assumptions a_team_that_stops_at_once_keeps_its_distances.
Print Assumptions no_robot_of_a_team_that_stops_at_once_comes_nearer_to_an_obstacle.
