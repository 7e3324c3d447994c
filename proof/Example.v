(** The assumptions of the theorem are satisfiable: two robots, one of which drives towards the other for one
    command timeout, by a command that it sends repeatedly. Hence the theorem is not vacuous. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Time Promise Counterexamples.
Open Scope R_scope.

(** H = 1 s, v_max = 1 m/s, d = 1 m, as in [S1]. The robot is at (x + pace min(t, 1), 0). *)
Definition answers (pace : R) (k : nat) : command :=
  Command 0 (INR k) k (match k with O => pace | _ => 0 end) 0 0.

(** The first answer is received at t = 0, 1, 2, ... *)
Definition again_and_again (pace : R) : mailbox :=
  Mailbox (fun _ => answers pace 0) INR (fun t => Z.to_nat (up t)).

Definition along_x (x pace : R) : robot :=
  Robot (fun _ => 0) (fun t => (x + pace * Rmin t 1, 0))
        (fun t => if Rlt_dec t 1 then pace else 0) (fun _ => 0) (fun _ => 0) 0
        (answers pace) (again_and_again pace).

(** Slack 1 m at the start; b is at least e^-2 m/s there, and the robot drives at 1/9 m/s. *)
Definition two_robots (b : bool) : robot := if b then along_x 2 (- (1 / 9)) else along_x 0 0.

Lemma mail_in_turn pace : chronological (again_and_again pace).
Proof.
  intros n t. simpl. destruct (archimed t) as [A1 A2].
  rewrite INR_IZR_INZ. split; intros Hn.
  - assert (Z.of_nat n < up t)%Z by lia.
    assert (Hz : (Z.of_nat n <= up t - 1)%Z) by lia. apply IZR_le in Hz. rewrite minus_IZR in Hz. lra.
  - assert (Hz : IZR (Z.of_nat n) < IZR (up t)) by lra. apply lt_IZR in Hz. lia.
Qed.

Lemma newest_is_the_first pace n : newest 1 (again_and_again pace) (S n) = Some (answers pace 0).
Proof.
  induction n as [|n IH].
  - simpl. unfold accept. simpl.
    destruct (Rle_dec 0 0); [|lra]. destruct (Rlt_dec 0 (0 + 1)); [reflexivity|lra].
  - change (accept 1 (INR (S n)) (answers pace 0) (newest 1 (again_and_again pace) (S n))
            = Some (answers pace 0)).
    rewrite IH. unfold accept.
    destruct (Rle_dec _ _); [|reflexivity]. destruct (Rlt_dec _ _); [|reflexivity].
    destruct (before_dec _ _); reflexivity.
Qed.

Lemma in_force_is pace t :
  0 <= t ->
  in_force 1 (again_and_again pace) t = if Rlt_dec t 1 then Some (answers pace 0) else None.
Proof.
  intros Ht. unfold in_force.
  assert (Hc : exists n, Plant.count (again_and_again pace) t = S n).
  { pose proof (proj2 (mail_in_turn pace 0%nat t) ltac:(simpl; lra)) as P.
    destruct (Plant.count (again_and_again pace) t) as [|n]; [lia|]. exists n. reflexivity. }
  destruct Hc as [n ->]. rewrite newest_is_the_first. simpl stamp. rewrite Rplus_0_l.
  destruct (Rlt_dec t 1); reflexivity.
Qed.

Lemma small_pace a : norm (a, 0) = Rabs a.
Proof.
  unfold norm, dot. simpl.
  replace (a * a + 0 * 0) with (Rsqr a) by (unfold Rsqr; ring). apply sqrt_Rsqr_abs.
Qed.

Lemma along_x_moves x pace : moves (along_x x pace).
Proof.
  assert (Hconst : forall c, continuous_from_0 (fun _ : R => c)).
  { intros c. apply continuous_of_continuity, continuity_const. intros a b. reflexivity. }
  assert (Hmin : continuous_from_0 (fun t => Rmin t 1)).
  { intros t Ht e He. exists e. split; [exact He|]. intros s Hs Hst.
    eapply Rle_lt_trans; [|exact Hst].
    unfold Rmin. destruct (Rle_dec s 1), (Rle_dec t 1);
      unfold Rabs; repeat match goal with |- context [Rcase_abs ?a] => destruct (Rcase_abs a) end; lra. }
  split; [simpl; lra|]. split; [exact (Hconst 0)|]. split; [|split; [exact (Hconst 0)|]].
  - simpl. intros t Ht e He.
    destruct (continuous_combination (fun _ => x) (fun t => Rmin t 1) 1 pace
                (Hconst x) Hmin t Ht e He) as [del [Hdel N]].
    exists del. split; [exact Hdel|]. intros s Hs Hst. specialize (N s Hs Hst).
    replace (x + pace * Rmin s 1 - (x + pace * Rmin t 1))
      with (1 * x + pace * Rmin s 1 - (1 * x + pace * Rmin t 1)) by ring. exact N.
  - intros t Ht. unfold front_velocity, rotate. simpl. rewrite cos_0, sin_0.
    assert (Hstill : forall c e, 0 < e -> exists del, 0 < del /\ forall h, 0 < h < del ->
              Rabs (c - c - 0 * h) <= e * h).
    { intros c e He. exists 1. split; [lra|]. intros h Hh.
      replace (c - c - 0 * h) with 0 by ring. rewrite Rabs_R0. nra. }
    split; [|split].
    + intros e He. apply (Hstill 0 e He).
    + intros e He. exists (if Rlt_dec t 1 then 1 - t else 1).
      destruct (Rlt_dec t 1) as [Hlt|Hge].
      * split; [lra|]. intros h Hh. rewrite !Rmin_left by lra.
        match goal with |- Rabs ?a <= _ => replace a with 0 by ring end. rewrite Rabs_R0. nra.
      * split; [lra|]. intros h Hh. rewrite !Rmin_right by lra.
        match goal with |- Rabs ?a <= _ => replace a with 0 by ring end. rewrite Rabs_R0. nra.
    + intros e He. destruct (Hstill 0 e He) as [del [Hdel N]]. exists del. split; [exact Hdel|].
      intros h Hh. specialize (N h Hh).
      match goal with |- Rabs ?a <= _ => replace a with (0 - 0 - 0 * h) by ring end. exact N.
Qed.

Lemma along_x_obeys x pace : Rabs pace <= 1 -> obeys 1 1 (along_x x pace).
Proof.
  intros Hp t Ht. simpl. rewrite in_force_is by exact Ht. rewrite small_pace.
  destruct (Rlt_dec t 1).
  - split; [exact Hp|]. split; [lra|]. exists 1. simpl. split; [lra|]. split; [ring|]. split; [ring|].
    exists 1. split; [lra|ring].
  - split; [rewrite Rabs_R0; lra|]. split; [lra|]. split; [reflexivity|]. split; reflexivity.
Qed.

Theorem the_assumptions_can_be_met : assumptions bool S1 two_robots.
Proof.
  assert (Hsmall : Rabs (- (1 / 9)) = 1 / 9) by (rewrite Rabs_Ropp, Rabs_pos_eq; lra).
  split.
  - unfold sensible, S1; simpl. lra.
  - intros [|]; apply along_x_moves.
  - intros [|]; apply along_x_obeys; [rewrite Hsmall; lra|rewrite Rabs_R0; lra].
  - intros [|]; apply mail_in_turn.
  - assert (H : forall pace, one_living_incarnation (answers pace)).
    { intros pace k l Hkl. apply lt_INR in Hkl. split; [|simpl; lra].
      right. split; [reflexivity|]. left. exact Hkl. }
    intros [|]; apply H.
  - intros [|] n; exists 0%nat; reflexivity.
  - intros [|] k; apply pos_INR.
  - intros [|] [|k]; try (left; split; [reflexivity|split; reflexivity]).
    right. exists (1 / 9), 0, 0. unfold S1; simpl.
    assert (Hspeed : norm (- (1 / 9), 0) = 1 / 9) by (rewrite small_pace; exact Hsmall).
    split; [lra|]. split; [lra|]. split; [unfold covers; simpl; rewrite Hspeed; lra|].
    split; [intros l Hl; lia|].
    intros o [[|] [Hj ->]]; [contradiction|].
    destruct (granted_head_on_is_certified S1 2 (1 / 9) 0 (answers (- (1 / 9)) 0))
      as [_ Hresp].
    + lra.
    + apply granted_S1; [lra|lra|left; lra].
    + exact Hspeed.
    + simpl. lra.
    + simpl. lra.
    + simpl in *. rewrite Rmin_left, Rmax_left in Hresp by lra.
      rewrite Rmin_left by lra.
      replace (minus (2 + - (1 / 9) * 0, 0) (0 + 0 * 0, 0)) with ((2, 0) : vec); [exact Hresp|].
      unfold minus; simpl. f_equal; ring.
  - assert (H2 : distance (two_robots true) (two_robots false) 0 = 2).
    { unfold distance, minus. simpl. rewrite Rmin_left by lra.
      unfold norm, dot; simpl.
      match goal with |- sqrt ?a = _ => replace a with (2 * 2) by ring end.
      apply sqrt_square. lra. }
    intros [|] [|] Hij; try contradiction; unfold S1; simpl.
    + unfold two_robots in H2. rewrite H2. lra.
    + rewrite distance_sym. unfold two_robots in H2. rewrite H2. lra.
Qed.
