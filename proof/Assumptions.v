(** What the main theorem rests on beside its hypotheses: the axioms of Coq's real numbers. The check
    compares this answer with `axioms.txt`. *)

From Phalanx Require Import Promise.

Print Assumptions no_two_robots_are_ever_nearer_than_d.
