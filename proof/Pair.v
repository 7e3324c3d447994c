(** Two robots that each use up at most half of what the core theorem permits are never nearer than dmin: E =
    e^(2 Lambda t) rho never decreases.

    This file does not depend on how they achieve it. *)

Require Import Reals Lra Psatz Lia.
From Phalanx Require Import Vectors Core Plant Geometry Motion.
Open Scope R_scope.

Definition distance (r o : robot) (t : R) : R := norm (minus (front r t) (front o t)).
Definition rho (dmin : R) (r o : robot) (t : R) : R := distance r o t - dmin.
(** The direction from o to r. *)
Definition direction (r o : robot) (t : R) : vec :=
  scale (/ distance r o t) (minus (front r t) (front o t)).

(** Half of the core's bound: n . alpha' >= - Lambda e^(-2 Lambda t) g. *)
Definition keeps_its_share (Lambda dmin : R) (r o : robot) : Prop :=
  forall t g, 0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho dmin r o) (2 * Lambda)) t g ->
  - (Lambda * exp (- (2 * Lambda) * t) * g) <= dot (direction r o t) (front_velocity r t).

Definition never_faster_than (V : R) (r : robot) : Prop :=
  forall t, 0 <= t -> norm (v r t, side r t) <= V.

Lemma distance_sym r o t : distance r o t = distance o r t.
Proof. apply norm_minus_sym. Qed.

Lemma distance_changes_at_most (V : R) r o s t :
  0 <= V -> moves r -> moves o -> never_faster_than V r -> never_faster_than V o ->
  0 <= s <= t -> Rabs (distance r o t - distance r o s) <= 2 * V * (t - s).
Proof.
  intros HV Hr Ho Or Oo Hst.
  assert (Mr : norm (minus (front r t) (front r s)) <= V * (t - s)).
  { apply front_moves_at_most; [exact Hr|exact HV|exact Hst|]. intros x Hx. apply (Or x). lra. }
  assert (Mo : norm (minus (front o s) (front o t)) <= V * (t - s)).
  { rewrite norm_minus_sym.
    apply front_moves_at_most; [exact Ho|exact HV|exact Hst|]. intros x Hx. apply (Oo x). lra. }
  set (z := minus (front r t) (front o t)). set (zs := minus (front r s) (front o s)).
  assert (T : norm (minus z zs)
              <= norm (minus (front r t) (front r s)) + norm (minus (front o s) (front o t))).
  { replace (minus z zs)
      with (plus (minus (front r t) (front r s)) (minus (front o s) (front o t)));
      [apply norm_plus|].
    unfold z, zs, plus, minus. simpl. f_equal; ring. }
  pose proof (norm_triangle z zs) as T1. pose proof (norm_triangle zs z) as T2.
  rewrite (norm_minus_sym zs z) in T2.
  unfold distance. fold z. fold zs. apply Rabs_le. lra.
Qed.

Lemma slack_continuous (V dmin : R) r o :
  0 <= V -> moves r -> moves o -> never_faster_than V r -> never_faster_than V o ->
  continuous_from_0 (rho dmin r o).
Proof.
  intros HV Hr Ho Or Oo t Ht e He.
  exists (e / (2 * V + 1)). split; [apply Rdiv_lt_0_compat; lra|].
  intros s Hs Hst.
  assert (B : 2 * V * Rabs (s - t) < e).
  { assert (X : (2 * V + 1) * Rabs (s - t) < e).
    { replace e with ((2 * V + 1) * (e / (2 * V + 1))) by (field; lra).
      apply Rmult_lt_compat_l; [lra|exact Hst]. }
    pose proof (Rabs_pos (s - t)). lra. }
  unfold rho. replace (distance r o s - dmin - (distance r o t - dmin))
    with (distance r o s - distance r o t) by ring.
  destruct (Rle_lt_dec t s) as [Hts|Hts].
  - pose proof (distance_changes_at_most V r o t s HV Hr Ho Or Oo ltac:(lra)) as L.
    rewrite (Rabs_pos_eq (s - t)) in B by lra. lra.
  - pose proof (distance_changes_at_most V r o s t HV Hr Ho Or Oo ltac:(lra)) as L.
    rewrite Rabs_minus_sym in L. rewrite (Rabs_left (s - t)) in B by lra. lra.
Qed.

Lemma running_max_ext (E E' : R -> R) t g :
  (forall x, E x = E' x) -> running_max E t g -> running_max E' t g.
Proof.
  intros HE [Hall [s [Hs Hg]]]. split.
  - intros x Hx. rewrite <- HE. apply Hall. exact Hx.
  - exists s. split; [exact Hs|]. rewrite <- HE. exact Hg.
Qed.

(** Both shares together: the slack decreases at most at 2 Lambda e^(-2 Lambda t) g. *)
Lemma slack_falls_at_most (Lambda dmin : R) (r o : robot) t g :
  moves r -> moves o -> keeps_its_share Lambda dmin r o -> keeps_its_share Lambda dmin o r ->
  0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho dmin r o) (2 * Lambda)) t g ->
  rises_at (rho dmin r o) t (- (2 * Lambda) * exp (- (2 * Lambda) * t) * g).
Proof.
  intros Mr Mo Hr Ho Ht Hdist Hg.
  assert (Hsym : forall x, rho dmin r o x = rho dmin o r x).
  { intros x. unfold rho. rewrite distance_sym. reflexivity. }
  pose proof (Hr t g Ht Hdist Hg) as Br.
  assert (Bo : - (Lambda * exp (- (2 * Lambda) * t) * g)
               <= dot (direction o r t) (front_velocity o t)).
  { apply Ho; [exact Ht|rewrite distance_sym; exact Hdist|].
    apply (running_max_ext (E_of (rho dmin r o) (2 * Lambda))); [|exact Hg].
    intros x. unfold E_of. rewrite Hsym. reflexivity. }
  set (n := direction r o t) in *.
  assert (Hn : direction o r t = scale (-1) n).
  { unfold n, direction. rewrite (distance_sym o r). unfold scale, minus. simpl. f_equal; ring. }
  rewrite Hn, scale_dot in Bo.
  assert (Hunit : norm n = 1).
  { unfold n, direction. rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hdist).
    unfold distance. field. unfold distance in Hdist. lra. }
  (* Along the direction n at time t, the projected distance is no larger than the true one. *)
  set (f := fun x => 1 * (fst n * fst (front r x) + snd n * snd (front r x))
                     + -1 * (fst n * fst (front o x) + snd n * snd (front o x))).
  assert (Hf : forall x, f x = dot n (minus (front r x) (front o x))).
  { intros x. unfold f, dot, minus. simpl. ring. }
  assert (Hbelow : forall x, f x <= distance r o x).
  { intros x. rewrite Hf. pose proof (dot_le_norms n (minus (front r x) (front o x))) as B.
    rewrite Hunit in B. unfold distance. lra. }
  assert (Hequal : f t = distance r o t).
  { rewrite Hf. unfold n, direction. rewrite scale_dot, <- norm_sq. fold (distance r o t).
    field. lra. }
  destruct Mr as [_ [_ [_ [_ Dr]]]]. destruct Mo as [_ [_ [_ [_ Do]]]].
  destruct (Dr t Ht) as [_ [Drx Dry]]. destruct (Do t Ht) as [_ [Dox Doy]].
  assert (Hrise : rises_at f t (- (2 * Lambda) * exp (- (2 * Lambda) * t) * g)).
  { apply rises_of_right_derivative with
      (1 * (fst n * fst (front_velocity r t) + snd n * snd (front_velocity r t))
       + -1 * (fst n * fst (front_velocity o t) + snd n * snd (front_velocity o t))).
    - apply (right_derivative_combination
               (fun x => fst n * fst (front r x) + snd n * snd (front r x))
               (fun x => fst n * fst (front o x) + snd n * snd (front o x)));
        apply right_derivative_combination; assumption.
    - unfold dot in Br, Bo. lra. }
  intros e He. destruct (Hrise e He) as [del [Hdel Hstep]].
  exists del. split; [exact Hdel|]. intros h Hh. specialize (Hstep h Hh).
  specialize (Hbelow (t + h)). unfold rho. rewrite Hequal in Hstep. lra.
Qed.

Theorem two_shares_keep_E_from_falling (Lambda dmin V : R) (r o : robot) s t :
  0 < Lambda -> 0 < dmin -> 0 <= V ->
  moves r -> moves o -> never_faster_than V r -> never_faster_than V o ->
  keeps_its_share Lambda dmin r o -> keeps_its_share Lambda dmin o r ->
  dmin <= distance r o 0 -> 0 <= s <= t ->
  E_of (rho dmin r o) (2 * Lambda) s <= E_of (rho dmin r o) (2 * Lambda) t.
Proof.
  intros HL Hd HV Mr Mo Vr Vo Sr So Hstart Hst.
  apply (core_slack _ _ dmin); [lra|exact Hd|unfold rho; lra| | |exact Hst].
  - apply (slack_continuous V); assumption.
  - intros u g Hu Hg Hhigh. apply slack_falls_at_most; try assumption.
    unfold rho in Hhigh. lra.
Qed.

Lemma E_keeps_the_distance (k dmin : R) (r o : robot) t :
  E_of (rho dmin r o) k 0 <= E_of (rho dmin r o) k t ->
  dmin <= distance r o 0 -> dmin <= distance r o t.
Proof.
  intros HE H0. unfold E_of in HE. rewrite Rmult_0_r, exp_0, Rmult_1_l in HE. unfold rho in HE.
  pose proof (exp_pos (k * t)) as P.
  destruct (Rle_lt_dec dmin (distance r o t)) as [|Hlt]; [assumption|exfalso].
  assert (exp (k * t) * (distance r o t - dmin) < 0) by nra. lra.
Qed.
