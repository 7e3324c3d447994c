(** The guard's certificate for a robot that stops at once, against another robot. `AtOnce.v` proves that while a
    command that satisfies it is in effect, the robot approaches no other faster than b, and b is at most Lambda
    times e^-2 of the slack at the sample, or Lambda times the current slack.

    The definitions from [rate] to [far] are the formulas of `Guard::grant_twist` and `Guard::collect_cones` in
    agent/src/avoidance/guard.rs. A test there reads them from this file, evaluates them and compares them with
    the code. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry.
Open Scope R_scope.

(** Constants of the scenario, common to all robots: the command timeout, s; the speed limit, m/s; the minimum
    distance, m; bounds on the errors of a sensed vector to another robot, m, and of the heading, rad; the
    margin that the guard subtracts from every distance, m. *)
Record setting := Setting {
  lifetime : R;        (* H *)
  v_max : R;
  d : R;
  eps : R;
  eta : R;
  rounding : R
}.

Definition sensible (S : setting) : Prop :=
  0 < lifetime S /\ 0 <= v_max S /\ 0 < d S /\ 0 <= eps S /\ 0 <= eta S /\
  0 <= rounding S.

(* Lambda *)
Definition rate (H : R) : R := 1 / H.
(* M *)
Definition reach (v_max v_own H eps : R) : R := (v_max + v_own) * H + eps.
(* rho, computed from sensed values *)
Definition slack (r eps d rounding : R) : R := Rmax (r - eps - d - rounding) 0.
(* b *)
Definition bound (H rho M : R) : R := rate H * Rmax (rho * exp (-2)) (rho - M).
(* maximum angle by which the direction to the other may turn *)
Definition swing (M r : R) : R := if Rlt_dec M r then asin (M / r) else PI.
(* thetabar *)
Definition middle (theta H w_low w_high : R) : R := theta + 1 / 2 * H * (w_low + w_high).
(* delta *)
Definition spread (H w_low w_high eta : R) : R := 1 / 2 * H * (w_high - w_low) + eta.
(* Psi *)
Definition psi (spread swing : R) : R := Rmin (spread + swing) PI.
(* K *)
Definition count (psi : R) : nat := if Rlt_dec psi (12 / 10) then 3 else 5.

(* distance from which on a robot need not be sensed *)
Definition far (d v_max H : R) : R := d + 3 * v_max * H.

(** The command [c] is within the bounds v_own and w_low to w_high. *)
Definition covers (v_own w_low w_high : R) (c : command) : Prop :=
  norm (speed c, across c) <= v_own /\ w_low <= turn c <= w_high.

(** Certificate of [c] with respect to one other robot, whose front point was at own - z_true at the sample: it
    is too far away to be sensed; or b is not restrictive; or the half-planes hold. *)
Definition respects (S : setting) (v_own w_low w_high theta : R) (c : command) (z_true : vec)
  : Prop :=
  far (d S) (v_max S) (lifetime S) <= norm z_true \/
  exists r n theta_sensed,
    0 <= r /\ dot n n = 1 /\ norm (minus (scale r n) z_true) <= eps S /\
    - eta S <= theta_sensed - theta <= eta S /\
    let M := reach (v_max S) v_own (lifetime S) (eps S) in
    let b := bound (lifetime S) (slack r (eps S) (d S) (rounding S)) M in
    let Psi := psi (spread (lifetime S) w_low w_high (eta S)) (swing M r) in
    v_own <= b \/
    cone_sides n (rotate (middle theta_sensed (lifetime S) w_low w_high) (speed c, across c))
      b Psi (count Psi).

Lemma count_fits p : 0 <= p <= PI -> (2 <= count p)%nat /\ cone_step p (count p) < PI.
Proof.
  intros Hp. pose proof PI2_3_2. unfold count, cone_step.
  destruct (Rlt_dec p (12 / 10)); simpl INR; split; try lia; lra.
Qed.

Lemma swing_bounds M r : 0 <= M -> 0 <= swing M r <= PI.
Proof.
  intros HM. pose proof PI_RGT_0. unfold swing. destruct (Rlt_dec M r) as [Hr|]; [|lra].
  pose proof (asin_bound (M / r)).
  assert (Hx : 0 <= M / r <= 1).
  { split; [apply Rdiv_le_0_compat; lra|].
    apply Rmult_le_reg_r with r; [lra|]. unfold Rdiv. rewrite Rmult_assoc, Rinv_l; lra. }
  split; [|lra].
  destruct (Rle_lt_dec 0 (asin (M / r))) as [|Hneg]; [assumption|exfalso].
  assert (Hsin : sin (asin (M / r)) < 0) by (apply sin_lt_0_var; lra).
  rewrite sin_asin in Hsin by lra. lra.
Qed.

Lemma rate_times_H h : 0 < h -> rate h * h = 1.
Proof. intros Hh. unfold rate. field. lra. Qed.

Lemma rate_pos h : 0 < h -> 0 < rate h.
Proof. intros Hh. unfold rate. apply Rdiv_lt_0_compat; lra. Qed.

Lemma bound_pos h rho M : 0 < h -> 0 <= rho -> 0 <= bound h rho M.
Proof.
  intros Hh Hrho. apply Rmult_le_pos; [left; apply rate_pos; exact Hh|].
  apply Rle_trans with (rho * exp (-2)); [|apply Rmax_l].
  apply Rmult_le_pos; [exact Hrho|left; apply exp_pos].
Qed.

(** The direction of z(t), relative to the true heading, is in the cone. *)
Lemma truth_is_in_the_cone (n z : vec) (r M mid spr theta_t : R) :
  dot n n = 1 -> 0 <= M -> 0 <= spr -> 0 < norm z ->
  norm (minus z (scale r n)) <= M -> - spr <= theta_t - mid <= spr ->
  exists x, - psi spr (swing M r) <= x <= psi spr (swing M r) /\
    forall y, dot (scale (/ norm z) z) (rotate theta_t y) = dot (rotate x n) (rotate mid y).
Proof.
  intros Hn HM Hspr Hz Hmoved Hturned.
  pose proof PI_RGT_0 as HPI. pose proof (swing_bounds M r HM) as Hsw.
  assert (Ha : exists a, - swing M r <= a <= swing M r /\ z = scale (norm z) (rotate a n)).
  { destruct (Rlt_dec M r) as [Hlt|Hge].
    - destruct (direction_within_asin n z r M Hn ltac:(lra) Hmoved) as [_ [a [B E]]].
      exists a. split; [|exact E]. unfold swing. destruct (Rlt_dec M r); [exact B|contradiction].
    - destruct (direction_is_a_turn n z Hn Hz) as [a [B [E _]]].
      exists a. split; [|exact E]. unfold swing. destruct (Rlt_dec M r); [contradiction|exact B]. }
  destruct Ha as [a [Ha Ez]].
  assert (Eunit : scale (/ norm z) z = rotate a n).
  { rewrite Ez at 2. unfold scale. destruct (rotate a n) as [p q]. simpl. f_equal; field; lra. }
  set (c := theta_t - mid) in *.
  assert (Eturn : forall y, dot (scale (/ norm z) z) (rotate theta_t y)
                            = dot (rotate (a - c) n) (rotate mid y)).
  { intros y. rewrite Eunit. replace theta_t with (c + mid) by (unfold c; ring).
    rewrite <- (rotate_dot (- c)), !rotate_rotate. f_equal; f_equal; ring. }
  destruct (Rle_lt_dec (spr + swing M r) PI) as [Hsmall|Hlarge].
  - exists (a - c). split; [|exact Eturn]. unfold psi. rewrite Rmin_left by exact Hsmall. lra.
  - assert (Hu1 : norm (rotate (a - c) n) = 1) by (rewrite rotate_norm; apply unit_norm, Hn).
    destruct (direction_is_a_turn n (rotate (a - c) n) Hn ltac:(lra)) as [x [Bx [Ex _]]].
    exists x. split.
    + unfold psi. rewrite Rmin_right by lra. exact Bx.
    + intros y. rewrite Eturn, Ex, Hu1, scale_dot. ring.
Qed.

Lemma psi_bounds spr M r : 0 <= spr -> 0 <= M -> 0 <= psi spr (swing M r) <= PI.
Proof.
  intros Hspr HM. pose proof PI_RGT_0. pose proof (swing_bounds M r HM).
  unfold psi. split; [apply Rmin_glb; lra|apply Rmin_r].
Qed.
