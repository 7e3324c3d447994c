(** A robot that stops at once stays clear of fixed convex obstacles: the guard without inertia, with the whole
    slack for the robot.

    The definitions [wall_bound] and [far_wall] are formulas of `Guard::collect_cones` and `known_walls_radius_m` in
    agent/src/avoidance/guard.rs. A test there compares them. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Time Inertia Braking AtOnce Obstacles.
Open Scope R_scope.

(* b next to a wall: twice that of a robot, with M = [reach 0 v_own H eps] *)
Definition wall_bound (H rho M : R) : R := 2 * bound H rho M.
(* distance from which on a wall need not be sensed *)
Definition far_wall (clear v_max H : R) : R := clear + 3 / 2 * v_max * H.

(** Certificate of [c] with respect to an obstacle whose nearest point was at front - z_true at the sample. *)
Definition respects_wall (S : Guard.setting) (clear v_own w_low w_high theta : R) (c : command)
    (z_true : vec) : Prop :=
  far_wall clear (Guard.v_max S) (Guard.lifetime S) <= norm z_true \/
  exists r n theta_sensed,
    0 <= r /\ dot n n = 1 /\ norm (minus (scale r n) z_true) <= Guard.eps S /\
    - Guard.eta S <= theta_sensed - theta <= Guard.eta S /\
    let M := reach 0 v_own (Guard.lifetime S) (Guard.eps S) in
    let b := wall_bound (Guard.lifetime S) (slack r (Guard.eps S) clear (Guard.rounding S)) M in
    let Psi := psi (spread (Guard.lifetime S) w_low w_high (Guard.eta S)) (swing M r) in
    v_own <= b \/
    cone_sides n
      (rotate (middle theta_sensed (Guard.lifetime S) w_low w_high) (speed c, across c))
      b Psi (count Psi).

Lemma respects_wall_is_certified (S : Guard.setting) (nearest : vec -> vec) (clear v_own w_low w_high theta : R)
    (c : command) (r : robot) (s : R) :
  Guard.sensible S -> 0 <= v_own -> w_low <= 0 <= w_high ->
  respects_wall S clear v_own w_low w_high theta c (minus (front r s) (nearest (front r s))) ->
  certified_at_once_against (at_once S) v_own w_low w_high theta c (an_obstacle (at_once S) nearest clear r) s.
Proof.
  intros [HH [HV [Hd [Heps [Heta Hrnd]]]]] Hown Hw Hresp.
  destruct Hresp as [Hfar|[q [n [theta_s [Hq [Hn [Herr [Htheta Hcase]]]]]]]]; [left|right].
  - simpl. eapply Rle_trans; [|exact Hfar].
    pose proof (far_at_once 2 clear (Guard.lifetime S) (Guard.v_max S) 0 HH ltac:(lra)) as B.
    unfold far_wall. lra.
  - exists q, n, theta_s. repeat (split; [assumption|]). cbv zeta in *. simpl.
    rewrite (bound_at_once 2 _ _ _ HH).
    destruct Hcase as [Hskip|Hsides]; [left; exact Hskip|right].
    apply half_planes_bound_the_cone; [| | |exact Hsides].
    + pose proof (bound_pos (Guard.lifetime S) (slack q (Guard.eps S) clear (Guard.rounding S))
                    (reach 0 v_own (Guard.lifetime S) (Guard.eps S)) HH (Rmax_r _ _)). lra.
    + unfold spread. assert (0 <= Guard.lifetime S * (w_high - w_low)) by (apply Rmult_le_pos; lra). lra.
    + unfold reach. assert (0 <= (0 + v_own) * Guard.lifetime S) by (apply Rmult_le_pos; lra). lra.
Qed.

(** ** The guarantee. *)

Definition certified_beside (S : Guard.setting) (nearest : vec -> vec) (clear : R) (r : robot) (k : nat)
  : Prop :=
  let c := computed r k in
  Time.stands c \/
  exists v_own w_low w_high,
    0 <= v_own <= Guard.v_max S /\ w_low <= 0 <= w_high /\
    covers v_own w_low w_high c /\
    covers_the_alive S r k v_own w_low w_high /\
    respects_wall S clear v_own w_low w_high (heading r (stamp c)) c
      (minus (front r (stamp c)) (nearest (front r (stamp c)))).

(** Requirements on a robot with respect to one obstacle. *)
Definition guarded_beside (S : Guard.setting) (nearest : vec -> vec) (clear : R) (r : robot) : Prop :=
  moves r /\ obeys (Guard.lifetime S) (Guard.v_max S) r /\
  chronological (mail r) /\ one_living_incarnation (computed r) /\
  sent_by (computed r) (mail r) /\
  forall k, 0 <= stamp (computed r k) /\ certified_beside S nearest clear r k.

Lemma guarded_beside_stops_at_once S nearest clear r :
  Guard.sensible S -> guarded_beside S nearest clear r ->
  stops_at_once (at_once S) (fun x => x = an_obstacle (at_once S) nearest clear r) r.
Proof.
  intros HS [A [B [C [D [E F]]]]]. repeat (split; [assumption|]). intros k.
  destruct (F k) as [F0 F1]. split; [exact F0|].
  destruct F1 as [Hs|[v [lo [hi [G1 [G2 [G3 [G4 G5]]]]]]]]; [left; exact Hs|right].
  exists v, lo, hi. rewrite without_rate_at_once. repeat (split; [assumption|]). intros x ->.
  apply respects_wall_is_certified; try assumption. apply G1.
Qed.

(** With any rate: in a team, Lambda is that of the longest command timeout. *)
Theorem no_robot_of_a_team_that_stops_at_once_comes_nearer_to_an_obstacle (S : braking_setting) (all : near -> Prop)
    (r : robot) (C : vec -> Prop) (nearest : vec -> vec) (clear : R) :
  sensible S -> stops_at_once S all r ->
  convex C -> nearest_of C nearest -> 0 < clear -> all (an_obstacle S nearest clear r) ->
  clear <= clearance nearest r 0 ->
  forall t, 0 <= t -> clear <= clearance nearest r t.
Proof.
  intros HS Hr HC HP Hclear Hall Hstart.
  apply (the_clearance_is_kept S r C); try assumption; try apply Hr.
  - intros x Hx. apply (proj1 (proj2 Hr) x Hx).
  - apply (share_of_the_slack_at_once S r all); try assumption.
    + apply (an_obstacle_moves_beside S C); assumption.
    + unfold its_slack. simpl. unfold clearance in Hstart. lra.
Qed.

Theorem no_robot_that_stops_at_once_comes_nearer_to_an_obstacle (S : Guard.setting)
    (r : robot) (C : vec -> Prop) (nearest : vec -> vec) (clear : R) :
  Guard.sensible S -> guarded_beside S nearest clear r ->
  convex C -> nearest_of C nearest -> 0 < clear ->
  clear <= clearance nearest r 0 ->
  forall t, 0 <= t -> clear <= clearance nearest r t.
Proof.
  intros HS Hr HC HP Hclear Hstart.
  apply (no_robot_of_a_team_that_stops_at_once_comes_nearer_to_an_obstacle (at_once S)
           (fun x => x = an_obstacle (at_once S) nearest clear r) r C); try assumption; [| |reflexivity].
  - apply sensible_at_once. exact HS.
  - apply guarded_beside_stops_at_once; assumption.
Qed.
