(** Bodies of robots, and the motion of their controlled point under a constant twist, as [moves] requires. *)
Require Import Reals Lra Psatz.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion.
Open Scope R_scope.

(** Position of the point after the time t at the constant velocity y in the robot's frame and the turn rate w, from the
    heading theta. *)
Definition arc_of (a1 a2 theta y1 y2 w t : R) : vec :=
  let c := t * sinc (w * t / 2) in
  plus (a1, a2) (scale c (rotate (theta + w * t / 2) (y1, y2))).

Lemma chord_of w t : w <> 0 -> t * sinc (w * t / 2) = 2 / w * sin (w * t / 2).
Proof. intros Hw. pose proof (chord_closed 1 w t Hw) as C. rewrite !Rmult_1_l in C. rewrite C. field. exact Hw. Qed.

Theorem point_of_a_held_twist (a1 a2 theta y1 y2 w t : R) :
  is_derive (fun s => fst (arc_of a1 a2 theta y1 y2 w s)) t (fst (rotate (theta + w * t) (y1, y2))) /\
  is_derive (fun s => snd (arc_of a1 a2 theta y1 y2 w s)) t (snd (rotate (theta + w * t) (y1, y2))).
Proof.
  destruct (Req_dec w 0) as [->|Hw].
  - assert (Hs : forall s, sinc (0 * s / 2) = 1).
    { intros s. unfold sinc. destruct (Req_EM_T (0 * s / 2) 0) as [|H]; [reflexivity|].
      exfalso. apply H. field. }
    split; [apply is_derive_ext with (fun s => a1 + s * (cos (theta + 0 * s / 2) * y1 - sin (theta + 0 * s / 2) * y2))
           |apply is_derive_ext with (fun s => a2 + s * (sin (theta + 0 * s / 2) * y1 + cos (theta + 0 * s / 2) * y2))];
      try (intros s; unfold arc_of, plus, scale, rotate; simpl; rewrite Hs; ring);
      auto_derive; try exact I; unfold rotate; simpl;
      replace (theta + 0 * t * / 2) with theta by field; replace (theta + 0 * t) with theta by ring; ring.
  - assert (Hhalf : theta + w * t = (theta + w * t / 2) + w * t / 2) by field.
    split; [apply is_derive_ext with (fun s => a1 + 2 / w * sin (w * s / 2) * (cos (theta + w * s / 2) * y1 - sin (theta + w * s / 2) * y2))
           |apply is_derive_ext with (fun s => a2 + 2 / w * sin (w * s / 2) * (sin (theta + w * s / 2) * y1 + cos (theta + w * s / 2) * y2))];
      try (intros s; unfold arc_of, plus, scale, rotate; simpl; rewrite (chord_of w s Hw); ring);
      auto_derive; try exact I; unfold rotate; simpl;
      change (w * t * / 2) with (w * t / 2); set (q := w * t / 2) in *;
      rewrite Hhalf; set (phi := theta + q); rewrite (cos_plus phi q), (sin_plus phi q); field; exact Hw.
Qed.

(** Front point, ell ahead of the axle: y = (v, ell w). Axle midpoint: y = (v, 0). Car at its rear axle: y = (v, 0) and
    |w| <= kappa |v|. Omnidirectional wheels: any y. Drone at a fixed height: any y, and heading 0. *)
Definition front_body (ell : R) (r : robot) : Prop := forall t, side r t = ell * w r t.
Definition axle_body (r : robot) : Prop := forall t, side r t = 0.
Definition car_body (kappa : R) (r : robot) : Prop :=
  forall t, side r t = 0 /\ Rabs (w r t) <= kappa * Rabs (v r t).

(** Bounds on the turn rate that follow from the speed: of a front point, and of a car. *)
Lemma front_turns_at_most ell r t V :
  0 < ell -> front_body ell r -> norm (v r t, side r t) <= V -> - (V / ell) <= w r t <= V / ell.
Proof.
  intros Hl Hf Hs. rewrite Hf in Hs. pose proof (norm_sq (v r t, ell * w r t)) as Q.
  pose proof (norm_pos (v r t, ell * w r t)) as P. unfold dot in Q; simpl in Q.
  assert (B : - V <= ell * w r t <= V) by (split; nra).
  split; apply Rmult_le_reg_l with ell; try exact Hl.
  - replace (ell * - (V / ell)) with (- V) by (field; lra). lra.
  - replace (ell * (V / ell)) with V by (field; lra). lra.
Qed.

Lemma car_turns_at_most kappa r t V :
  0 <= kappa -> car_body kappa r -> norm (v r t, side r t) <= V -> - (kappa * V) <= w r t <= kappa * V.
Proof.
  intros Hk Hc Hs. destruct (Hc t) as [Hz Hw]. rewrite Hz in Hs.
  assert (E : Rabs (v r t) <= norm (v r t, 0)).
  { unfold norm, dot; simpl. replace (v r t * v r t + 0 * 0) with (Rsqr (v r t)) by (unfold Rsqr; ring).
    rewrite sqrt_Rsqr_abs. lra. }
  assert (kappa * Rabs (v r t) <= kappa * V) by (apply Rmult_le_compat_l; lra).
  apply Rabs_le_between. lra.
Qed.
