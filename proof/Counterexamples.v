(** Each rule is needed: without it there are robots whose every command is certified, and that come nearer than
    d.

    - if the command timeout counts from the arrival of a command instead of from its sample;
    - if the agent assumes a quarter of the command timeout that the plant grants;
    - if the agent forgets its own unexpired commands. *)

Require Import Reals Lra Psatz Lia List.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Guard.
Import ListNotations.
Open Scope R_scope.

(** ** Two robots on a line, moving towards each other in legs at constant speed. *)

(** The speed [pace], granted at [sampled], is in effect from [from] until [until]. *)
Record leg := Leg { sampled : R; from : R; until : R; pace : R }.

Definition gone (t : R) (l : leg) : R := pace l * Rmax 0 (Rmin t (until l) - from l).
Definition gap (start : R) (legs : list leg) (t : R) : R :=
  fold_right (fun l r => r - gone t l) start legs.

(** The guard grants this command unchanged: v_own <= b, the case of [respects] in which no half-plane is
    needed. *)
Definition granted_head_on (S : setting) (r v : R) : Prop :=
  0 <= v <= v_max S /\
  v <= bound (lifetime S) (slack r (eps S) (d S) (rounding S)) (reach (v_max S) v (lifetime S) (eps S)).

Lemma granted_head_on_is_certified S r v theta c :
  0 <= r -> granted_head_on S r v -> norm (speed c, across c) = v -> 0 <= eps S -> 0 <= eta S ->
  covers v (Rmin 0 (turn c)) (Rmax 0 (turn c)) c /\
  respects S v (Rmin 0 (turn c)) (Rmax 0 (turn c)) theta c (r, 0).
Proof.
  intros Hr [_ Hb] Hv Heps Heta. split.
  - split; [lra|]. split; [apply Rmin_r|apply Rmax_r].
  - right. exists r, (1, 0), theta. split; [exact Hr|].
    split; [unfold dot; simpl; ring|]. split; [|split; [lra|left; exact Hb]].
    replace (minus (scale r (1, 0)) (r, 0)) with (0, 0).
    + unfold norm, dot; simpl. replace (0 * 0 + 0 * 0) with 0 by ring. rewrite sqrt_0. exact Heps.
    + unfold minus, scale; simpl. f_equal; ring.
Qed.

(** H = 1 s, v_max = 1 m/s, d = 1 m. *)
Definition S1 : setting := Setting 1 1 1 0 0 0.

Lemma e_minus_2 : 1 / 9 <= exp (-2).
Proof.
  replace (-2) with (- (1 + 1)) by ring. rewrite exp_Ropp, exp_plus.
  pose proof exp_le_3. pose proof (exp_pos 1).
  assert (H9 : exp 1 * exp 1 <= 9) by nra.
  unfold Rdiv. rewrite Rmult_1_l. apply Rinv_le_contravar; [nra|exact H9].
Qed.

Lemma granted_S1 r v :
  1 <= r -> 0 <= v <= 1 -> v <= (r - 1) / 9 \/ v <= r - 1 - (1 + v) -> granted_head_on S1 r v.
Proof.
  intros Hr Hv Hor. unfold granted_head_on, S1; simpl. split; [exact Hv|].
  unfold bound, slack, reach, rate. rewrite (Rmax_left (r - 0 - 1 - 0) 0) by lra.
  replace (1 / 1) with 1 by field. rewrite Rmult_1_l.
  pose proof e_minus_2 as He.
  destruct Hor as [H1|H2].
  - apply Rle_trans with ((r - 0 - 1 - 0) * exp (-2)); [|apply Rmax_l].
    assert ((r - 0 - 1 - 0) * (1 / 9) <= (r - 0 - 1 - 0) * exp (-2))
      by (apply Rmult_le_compat_l; lra). lra.
  - apply Rle_trans with (r - 0 - 1 - 0 - ((1 + v) * 1 + 0)); [lra|apply Rmax_r].
Qed.

(** Decides the cases of minima and maxima of numbers, inner ones first. *)
Ltac numbers :=
  unfold gap, gone, Rmax, Rmin; simpl;
  repeat match goal with
  | |- context [Rle_dec ?a ?b] =>
      lazymatch a with
      | context [Rle_dec] => fail
      | _ =>
          lazymatch b with
          | context [Rle_dec] => fail
          | _ => destruct (Rle_dec a b); try (exfalso; lra)
          end
      end
  end; lra.

(** ** Expiry counted from the arrival. *)

(** Robot i computes one command at t = 0, and is stopped between reading and sending: the command arrives at t
    = 6. Meanwhile robot j approaches, and each of its commands is granted at its own sample. *)
Definition late : leg := Leg 0 6 7 1.
Definition others : list leg :=
  [Leg 0 0 1 1; Leg 1 1 2 (1/2); Leg 2 2 3 (1/4); Leg 3 3 4 (1/8); Leg 4 4 5 (1/8); Leg 5 5 6 (1/9)].

Theorem with_expiry_from_arrival_the_promise_is_broken :
  let legs := late :: others in
  (* every command is granted for the distance at its sample, *)
  (forall l, In l legs -> granted_head_on S1 (gap 4 legs (sampled l)) (pace l)) /\
  (* and is in effect for H from its arrival, *)
  (forall l, In l legs -> sampled l <= from l /\ until l = from l + lifetime S1) /\
  (* but two robots that start 4 d apart end up closer than d. *)
  gap 4 legs 7 < d S1.
Proof.
  intros legs.
  assert (G0 : gap 4 legs 0 = 4) by (unfold legs, late, others; numbers).
  assert (G1 : gap 4 legs 1 = 3) by (unfold legs, late, others; numbers).
  assert (G2 : gap 4 legs 2 = 5 / 2) by (unfold legs, late, others; numbers).
  assert (G3 : gap 4 legs 3 = 9 / 4) by (unfold legs, late, others; numbers).
  assert (G4 : gap 4 legs 4 = 17 / 8) by (unfold legs, late, others; numbers).
  assert (G5 : gap 4 legs 5 = 2) by (unfold legs, late, others; numbers).
  assert (G7 : gap 4 legs 7 = 8 / 9) by (unfold legs, late, others; numbers).
  split; [|split].
  - intros l [<-|[<-|[<-|[<-|[<-|[<-|[<-|[]]]]]]]]; cbn [sampled pace late];
      rewrite ?G0, ?G1, ?G2, ?G3, ?G4, ?G5; apply granted_S1; try lra;
      (left; lra) || (right; lra).
  - intros l [<-|[<-|[<-|[<-|[<-|[<-|[<-|[]]]]]]]]; simpl; lra.
  - rewrite G7. simpl. lra.
Qed.

(** The plant's rule refuses that command: at t = 6 it has been expired for five timeouts. *)
Theorem the_plant_refuses_it (c : command) (newest : option command) :
  stamp c = sampled late -> accept (lifetime S1) (from late) c newest = newest.
Proof.
  intros Hs. unfold accept. rewrite Hs. simpl.
  destruct (Rle_dec 0 6); [|reflexivity]. destruct (Rlt_dec 6 (0 + 1)); [lra|reflexivity].
Qed.

(** ** An agent that assumes a quarter of the command timeout. *)

(** The guard's setting has H = 1 s, but the plant keeps commands in effect for 4 s. The processes of both
    robots are killed. *)
Theorem with_a_quarter_of_the_lifetime_the_promise_is_broken :
  let legs := [Leg 0 0 4 1; Leg 0 0 4 1] in
  (forall l, In l legs -> granted_head_on S1 (gap 4 legs (sampled l)) (pace l)) /\
  (forall l, In l legs -> until l = sampled l + 4 * lifetime S1) /\
  gap 4 legs 4 < d S1.
Proof.
  intros legs.
  assert (G0 : gap 4 legs 0 = 4) by (unfold legs; numbers).
  assert (G4 : gap 4 legs 4 = -4) by (unfold legs; numbers).
  split; [|split].
  - intros l [<-|[<-|[]]]; cbn [sampled pace]; rewrite G0; apply granted_S1; lra.
  - intros l [<-|[<-|[]]]; simpl; lra.
  - rewrite G4. simpl. lra.
Qed.

(** ** Own unexpired commands are forgotten. *)

(** H = 1 s, v_max = 1 m/s, d = 10 m, ell = 1 mm. The other robot is at rest at the origin. This robot is 0.5 m
    beyond d and faces away. For one sample it computes two commands: first turn on the spot, then drive away.
    Each is certified by itself. The second takes effect when the first has turned the robot around, and drives
    it towards the other. *)
Definition S2 : setting := Setting 1 1 10 0 0 0.
Definition ell2 : R := 1 / 1000.
Definition turn_round : command := Command 0 0 1 0 (ell2 * 40) 40.
Definition drive_away : command := Command 0 0 2 1 0 0.

(** Position of the front point after [turn_round] was in effect for t1 and [drive_away] after it for t2. *)
Definition front_after (t1 t2 : R) : vec :=
  let axle := (10 + 1 / 2 - ell2, 0) in
  arc_front (fst axle) (snd axle) (40 * t1) ell2 1 0 t2.

Lemma turn_round_is_certified :
  covers (4 / 100) 0 40 turn_round /\
  respects S2 (4 / 100) 0 40 0 turn_round (10 + 1 / 2, 0).
Proof.
  pose proof e_minus_2 as He. split.
  - split; [|simpl; lra]. simpl.
    apply norm_le; [lra|]. unfold dot, ell2; simpl. lra.
  - right. exists (10 + 1 / 2), (1, 0), 0. split; [lra|]. split; [unfold dot; simpl; ring|].
    split.
    + replace (minus (scale (10 + 1 / 2) (1, 0)) (10 + 1 / 2, 0)) with (0, 0).
      * unfold norm, dot; simpl. replace (0 * 0 + 0 * 0) with 0 by ring. rewrite sqrt_0. lra.
      * unfold minus, scale; simpl. f_equal; ring.
    + split; [simpl; lra|]. left. unfold bound, slack, reach, rate, S2; simpl.
      rewrite (Rmax_left (10 + 1 / 2 - 0 - 10 - 0) 0) by lra.
      replace (1 / 1) with 1 by field. rewrite Rmult_1_l.
      eapply Rle_trans; [|apply Rmax_l]. lra.
Qed.

Lemma drive_away_is_certified_by_itself :
  covers 1 0 0 drive_away /\ respects S2 1 0 0 0 drive_away (10 + 1 / 2, 0).
Proof.
  split.
  - split; [|simpl; lra]. simpl.
    apply norm_le; [lra|]. unfold dot; simpl. lra.
  - right. exists (10 + 1 / 2), (1, 0), 0. split; [lra|]. split; [unfold dot; simpl; ring|].
    split.
    + replace (minus (scale (10 + 1 / 2) (1, 0)) (10 + 1 / 2, 0)) with (0, 0).
      * unfold norm, dot; simpl. replace (0 * 0 + 0 * 0) with 0 by ring. rewrite sqrt_0. lra.
      * unfold minus, scale; simpl. f_equal; ring.
    + split; [simpl; lra|]. right. simpl.
      set (M := reach 1 1 1 0). set (rho := slack (10 + 1 / 2) 0 10 0).
      set (b := bound 1 rho M).
      set (P := psi (spread 1 0 0 0) (swing M (10 + 1 / 2))).
      assert (HM : M = 2) by (unfold M, reach; lra).
      assert (Hb : 0 <= b) by (apply bound_pos; [lra|apply Rmax_r]).
      pose proof PI_RGT_0 as HPI.
      pose proof (swing_bounds M (10 + 1 / 2) ltac:(lra)) as Hsw.
      assert (Hsmall : swing M (10 + 1 / 2) <= PI / 2).
      { unfold swing. destruct (Rlt_dec M (10 + 1 / 2)); [|lra].
        apply (asin_bound (M / (10 + 1 / 2))). }
      assert (HP : 0 <= P <= PI / 2).
      { unfold P, psi, spread. split; [apply Rmin_glb; lra|].
        eapply Rle_trans; [apply Rmin_l|]. lra. }
      destruct (count_fits P ltac:(lra)) as [HK Hstep].
      assert (HKR : 2 <= INR (count P)) by (replace 2 with (INR 2) by reflexivity; apply le_INR; exact HK).
      assert (Hfull : (INR (count P) - 1) * cone_step P (count P) = 2 * P)
        by (unfold cone_step; field; lra).
      assert (Hst0 : 0 <= cone_step P (count P)) by (unfold cone_step; apply Rdiv_le_0_compat; lra).
      intros q Hq. unfold side_angle, side_bound.
      assert (HqR : 0 <= INR q <= INR (count P) - 1).
      { split; [apply pos_INR|]. apply le_INR in Hq. rewrite S_INR in Hq. lra. }
      assert (Hx : 0 <= INR q * cone_step P (count P) <= 2 * P).
      { split; [apply Rmult_le_pos; lra|]. rewrite <- Hfull. apply Rmult_le_compat_r; lra. }
      unfold dot, rotate, middle; simpl.
      replace (0 + 1 / 2 * 1 * (0 + 0)) with 0 by ring. rewrite cos_0, sin_0.
      assert (0 <= cos (- P + INR q * cone_step P (count P))) by (apply cos_ge_0; lra).
      assert (0 <= cos (cone_step P (count P) / 2)) by (apply cos_ge_0; lra).
      assert (0 <= b * cos (cone_step P (count P) / 2)) by (apply Rmult_le_pos; assumption).
      lra.
Qed.

(** [turn_round] is in effect for PI/40 s, half a revolution, then [drive_away] until its stamp + H. *)
Theorem without_the_alive_commands_the_promise_is_broken :
  0 < PI / 40 < lifetime S2 /\
  norm (front_after 0 0) = 10 + 1 / 2 /\
  norm (front_after (PI / 40) (lifetime S2 - PI / 40)) < d S2.
Proof.
  pose proof PI_RGT_0. pose proof PI_4 as H4. unfold S2; simpl.
  assert (Hsinc : forall t, sinc (0 * t / 2) = 1).
  { intros t. unfold sinc. destruct (Req_EM_T (0 * t / 2) 0) as [|N]; [reflexivity|].
    exfalso. apply N. field. }
  split; [lra|]. split.
  - unfold front_after, arc_front. simpl. rewrite Hsinc.
    replace (40 * 0 + 0 * 0 / 2) with 0 by field. replace (40 * 0 + 0 * 0) with 0 by ring.
    rewrite cos_0, sin_0. unfold norm, dot; simpl.
    replace ((10 + 1 / 2 - ell2 + 1 * 0 * 1 * 1 + ell2 * 1) * (10 + 1 / 2 - ell2 + 1 * 0 * 1 * 1 + ell2 * 1)
             + (0 + 1 * 0 * 1 * 0 + ell2 * 0) * (0 + 1 * 0 * 1 * 0 + ell2 * 0))
      with ((10 + 1 / 2) * (10 + 1 / 2)) by ring.
    apply sqrt_square. lra.
  - apply Rle_lt_trans with (98 / 10); [|lra].
    apply norm_le; [lra|]. unfold front_after, arc_front. simpl. rewrite Hsinc.
    replace (40 * (PI / 40) + 0 * (1 - PI / 40) / 2) with PI by field.
    replace (40 * (PI / 40) + 0 * (1 - PI / 40)) with PI by field.
    rewrite cos_PI, sin_PI. unfold dot, ell2; simpl.
    assert (0 < PI / 40 <= 1 / 10) by lra. nra.
Qed.
