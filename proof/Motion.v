(** Bounds on the motion of the robots: a robot commanded at most v_own since its sample, with turn rates
    between w_low and w_high, has moved by at most v_own (t - s) and has turned by between w_low (t - s) and
    w_high (t - s). Hence two robots have moved by at most M relative to each other.

    The motion is given by its derivative from the right, which exists also where a command starts. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry.
Open Scope R_scope.

Definition right_derivative (f : R -> R) (t l : R) : Prop :=
  forall e, 0 < e ->
  exists del, 0 < del /\ forall h, 0 < h < del -> Rabs (f (t + h) - f t - l * h) <= e * h.

(** One robot: its body, its motion, the commands that its processes computed, and those that the plant
    received. *)
Record robot := Robot {
  heading : R -> R;        (* theta(t), rad *)
  front : R -> vec;        (* alpha(t), the controlled point, m *)
  v : R -> R;              (* speed executed by the wheels at t, m/s *)
  side : R -> R;           (* speed of the controlled point to the left: ell w of a front point, 0 of an axle, m/s *)
  w : R -> R;              (* turn rate executed by the wheels at t, rad/s *)
  spin : R;                (* maximum turn rate, rad/s *)
  computed : nat -> command;
  mail : mailbox
}.

(** Velocity of the controlled point: A(theta) (v, w) for a front point, `front_velocity`. *)
Definition front_velocity (r : robot) (t : R) : vec :=
  rotate (heading r t) (v r t, side r t).

(** `World::advance` integrates the unicycle. *)
Definition moves (r : robot) : Prop :=
  0 <= spin r /\
  continuous_from_0 (heading r) /\
  continuous_from_0 (fun t => fst (front r t)) /\
  continuous_from_0 (fun t => snd (front r t)) /\
  forall t, 0 <= t ->
    right_derivative (heading r) t (w r t) /\
    right_derivative (fun t => fst (front r t)) t (fst (front_velocity r t)) /\
    right_derivative (fun t => snd (front r t)) t (snd (front_velocity r t)).

(** The wheels execute the command in force, or a fraction of it: the speed limit of `accept`, wheel limits and
    failing wheels scale (v, w) down together. A turn rate that is independent of the velocity may be reduced by itself.
    Without a command in force they are at rest. *)
Definition obeys (H v_max : R) (r : robot) : Prop :=
  forall t, 0 <= t ->
  norm (v r t, side r t) <= v_max /\ - spin r <= w r t <= spin r /\
  match in_force H (mail r) t with
  | None => v r t = 0 /\ side r t = 0 /\ w r t = 0
  | Some c => exists lam, 0 <= lam <= 1 /\ v r t = lam * speed c /\ side r t = lam * across c /\
    exists part, 0 <= part <= 1 /\ w r t = part * turn c
  end.

(** ** Rates. *)

Lemma rises_of_right_derivative f t l l' :
  right_derivative f t l -> l' <= l -> rises_at f t l'.
Proof.
  intros Hf Hl e He. destruct (Hf e He) as [del [Hdel Hstep]].
  exists del. split; [exact Hdel|]. intros h Hh. specialize (Hstep h Hh).
  apply Rabs_le_between in Hstep. nra.
Qed.

Lemma right_derivative_combination f g t l m a b :
  right_derivative f t l -> right_derivative g t m ->
  right_derivative (fun s => a * f s + b * g s) t (a * l + b * m).
Proof.
  intros Hf Hg e He. pose proof (Rabs_pos a). pose proof (Rabs_pos b).
  destruct (Hf (e / (2 * (Rabs a + 1))) ltac:(apply Rdiv_lt_0_compat; lra)) as [d1 [H1 S1]].
  destruct (Hg (e / (2 * (Rabs b + 1))) ltac:(apply Rdiv_lt_0_compat; lra)) as [d2 [H2 S2]].
  exists (Rmin d1 d2). split; [apply Rmin_glb_lt; assumption|].
  intros h Hh. pose proof (Rmin_l d1 d2). pose proof (Rmin_r d1 d2).
  specialize (S1 h ltac:(lra)). specialize (S2 h ltac:(lra)).
  replace (a * f (t + h) + b * g (t + h) - (a * f t + b * g t) - (a * l + b * m) * h)
    with (a * (f (t + h) - f t - l * h) + b * (g (t + h) - g t - m * h)) by ring.
  eapply Rle_trans; [apply Rabs_triang|]. rewrite !Rabs_mult.
  assert (X : forall x y, 0 <= x -> y <= e / (2 * (x + 1)) * h -> x * y <= e / 2 * h).
  { intros x y Hx Hy. apply Rle_trans with (x * (e / (2 * (x + 1)) * h)).
    - apply Rmult_le_compat_l; assumption.
    - replace (x * (e / (2 * (x + 1)) * h)) with (x / (x + 1) * (e / 2 * h)) by (field; lra).
      assert (x / (x + 1) <= 1).
      { apply Rmult_le_reg_r with (x + 1); [lra|]. unfold Rdiv. rewrite Rmult_assoc, Rinv_l; lra. }
      assert (0 <= e / 2 * h) by nra. nra. }
  specialize (X (Rabs a) _ ltac:(lra) S1) as X1. specialize (X (Rabs b) _ ltac:(lra) S2) as X2. lra.
Qed.

Lemma continuous_combination f g a b :
  continuous_from_0 f -> continuous_from_0 g -> continuous_from_0 (fun s => a * f s + b * g s).
Proof.
  intros Hf Hg.
  assert (Hconst : forall c, continuous_from_0 (fun _ => c)).
  { intros c. apply continuous_of_continuity, continuity_const. intros x y. reflexivity. }
  assert (Hneg : continuous_from_0 (fun s => 0 - b * g s)).
  { apply continuous_minus; [apply Hconst|]. apply continuous_mult; [apply Hconst|exact Hg]. }
  assert (H : continuous_from_0 (fun s => a * f s - (0 - b * g s))).
  { apply continuous_minus; [|exact Hneg]. apply continuous_mult; [apply Hconst|exact Hf]. }
  intros t Ht e He. destruct (H t Ht e He) as [del [Hdel N]].
  exists del. split; [exact Hdel|]. intros s Hs Hst. specialize (N s Hs Hst).
  replace (a * f s + b * g s - (a * f t + b * g t))
    with (a * f s - (0 - b * g s) - (a * f t - (0 - b * g t))) by ring. exact N.
Qed.

Lemma identity_continuous : continuous_from_0 (fun s => s).
Proof. intros t Ht e He. exists e. split; [exact He|]. intros s _ Hs. exact Hs. Qed.

Lemma identity_right_derivative t : right_derivative (fun s => s) t 1.
Proof.
  intros e He. exists 1. split; [lra|]. intros h Hh.
  replace (t + h - t - 1 * h) with 0 by ring. rewrite Rabs_R0. nra.
Qed.

(** A function that changes at most at the rate L changes by at most L (t - s). *)
Lemma goes_at_most (f l : R -> R) (L s t : R) :
  continuous_from_0 f -> 0 <= s <= t ->
  (forall x, s <= x < t -> right_derivative f x (l x) /\ l x <= L) ->
  f t - f s <= L * (t - s).
Proof.
  intros Hc Hst Hd.
  assert (H : L * s + -1 * f s <= L * t + -1 * f t).
  { apply (never_falls (fun x => L * x + -1 * f x)).
    - apply continuous_combination; [apply identity_continuous|exact Hc].
    - exact Hst.
    - intros x Hx. destruct (Hd x Hx) as [D HL].
      apply rises_of_right_derivative with (L * 1 + -1 * l x); [|lra].
      apply right_derivative_combination; [apply identity_right_derivative|exact D]. }
  lra.
Qed.

Lemma goes_at_least (f l : R -> R) (L s t : R) :
  continuous_from_0 f -> 0 <= s <= t ->
  (forall x, s <= x < t -> right_derivative f x (l x) /\ L <= l x) ->
  L * (t - s) <= f t - f s.
Proof.
  intros Hc Hst Hd.
  assert (H : -1 * f t + 0 * f t - (-1 * f s + 0 * f s) <= - L * (t - s)).
  { apply (goes_at_most (fun x => -1 * f x + 0 * f x) (fun x => -1 * l x + 0 * l x)).
    - apply continuous_combination; exact Hc.
    - exact Hst.
    - intros x Hx. destruct (Hd x Hx) as [D HL]. split; [|lra].
      apply right_derivative_combination; exact D. }
  lra.
Qed.

(** ** Distances and angles. *)

Theorem front_moves_at_most (r : robot) (V s t : R) :
  moves r -> 0 <= V -> 0 <= s <= t ->
  (forall x, s <= x < t -> norm (v r x, side r x) <= V) ->
  norm (minus (front r t) (front r s)) <= V * (t - s).
Proof.
  intros [_ [_ [Cx [Cy Hd]]]] HV Hst Hspeed.
  set (D := minus (front r t) (front r s)).
  assert (H : dot D D <= norm D * V * (t - s)).
  { replace (dot D D) with (fst D * fst (front r t) + snd D * snd (front r t)
                            - (fst D * fst (front r s) + snd D * snd (front r s)))
      by (unfold D, dot, minus; simpl; ring).
    apply (goes_at_most (fun x => fst D * fst (front r x) + snd D * snd (front r x))
             (fun x => fst D * fst (front_velocity r x) + snd D * snd (front_velocity r x))).
    - apply continuous_combination; assumption.
    - exact Hst.
    - intros x Hx. destruct (Hd x ltac:(lra)) as [_ [Dx Dy]]. split.
      + apply right_derivative_combination; assumption.
      + change (dot D (front_velocity r x) <= norm D * V).
        pose proof (dot_le_norms D (front_velocity r x)) as B.
        unfold front_velocity in B at 2. rewrite rotate_norm in B.
        specialize (Hspeed x Hx). pose proof (norm_pos D). nra. }
  rewrite <- norm_sq in H. pose proof (norm_pos D) as P.
  destruct (Rle_lt_or_eq_dec 0 (norm D) P) as [Hpos|H0]; [nra|rewrite <- H0; nra].
Qed.

Theorem heading_turns_within (r : robot) (lo hi s t : R) :
  moves r -> 0 <= s <= t ->
  (forall x, s <= x < t -> lo <= w r x <= hi) ->
  lo * (t - s) <= heading r t - heading r s <= hi * (t - s).
Proof.
  intros [_ [Ch [_ [_ Hd]]]] Hst Hw. split.
  - apply (goes_at_least _ (w r)); [exact Ch|exact Hst|].
    intros x Hx. split; [apply (Hd x); lra|apply (Hw x Hx)].
  - apply (goes_at_most _ (w r)); [exact Ch|exact Hst|].
    intros x Hx. split; [apply (Hd x); lra|apply (Hw x Hx)].
Qed.

(** An exact arc, as computed by `unicycle::arc`, has these derivatives at every instant. *)
Lemma right_derivative_of_is_derive f t l : is_derive f t l -> right_derivative f t l.
Proof.
  intros Hf e He. apply is_derive_Reals in Hf. destruct (Hf e He) as [del Hdel].
  exists del. split; [apply cond_pos|]. intros h Hh.
  specialize (Hdel h ltac:(lra) ltac:(rewrite Rabs_pos_eq; lra)).
  replace (f (t + h) - f t - l * h) with (((f (t + h) - f t) / h - l) * h) by (field; lra).
  rewrite Rabs_mult, (Rabs_pos_eq h) by lra. apply Rmult_le_compat_r; lra.
Qed.

Theorem an_arc_moves_like_this (x y theta l v w t : R) :
  right_derivative (fun s => theta + w * s) t w /\
  right_derivative (fun s => fst (arc_front x y theta l v w s)) t
                   (fst (rotate (theta + w * t) (v, l * w))) /\
  right_derivative (fun s => snd (arc_front x y theta l v w s)) t
                   (snd (rotate (theta + w * t) (v, l * w))).
Proof.
  split; [|split; apply right_derivative_of_is_derive, front_point_of_a_held_twist].
  apply right_derivative_of_is_derive. auto_derive; [exact I|ring].
Qed.
