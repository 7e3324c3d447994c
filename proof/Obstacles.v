(** A robot that brakes stays clear of fixed convex obstacles: the result for two robots holds for the nearest
    point of an obstacle, with the whole slack for the robot.

    An obstacle that is not convex is given as convex parts, each sensed separately. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Inertia Braking.
Open Scope R_scope.

(** ** The nearest point of a convex set. *)

Definition convex (C : vec -> Prop) : Prop :=
  forall p q k, C p -> C q -> 0 <= k <= 1 -> C (plus p (scale k (minus q p))).

(** [nearest z] is in C, and no point of C is nearer to z. *)
Definition nearest_of (C : vec -> Prop) (nearest : vec -> vec) : Prop :=
  forall z, C (nearest z) /\ forall q, C q -> norm (minus z (nearest z)) <= norm (minus z q).

Lemma norm_le_dot u v : norm u <= norm v -> dot u u <= dot v v.
Proof.
  intros H. rewrite <- !norm_sq. pose proof (norm_pos u). nra.
Qed.

(** All of C is behind the line through the nearest point, perpendicular to the direction to z. *)
Lemma behind_the_nearest_point C nearest z q :
  convex C -> nearest_of C nearest -> C q ->
  dot (minus z (nearest z)) (minus q (nearest z)) <= 0.
Proof.
  intros HC HP Hq. destruct (HP z) as [Hin Hnear].
  set (a := minus z (nearest z)) in *. set (e := minus q (nearest z)) in *.
  destruct (Rle_lt_dec (dot a e) 0) as [|Hpos]; [assumption|exfalso].
  assert (Hstep : forall k, 0 < k <= 1 -> 2 * dot a e <= k * dot e e).
  { intros k Hk.
    assert (B := Hnear _ (HC (nearest z) q k Hin Hq ltac:(lra))).
    apply norm_le_dot in B. fold a in B. fold e in B.
    replace (minus z (plus (nearest z) (scale k e))) with (minus a (scale k e)) in B
      by (unfold a, minus, plus; simpl; f_equal; ring).
    assert (E : dot (minus a (scale k e)) (minus a (scale k e))
                = dot a a - 2 * k * dot a e + k * (k * dot e e)).
    { destruct a, e. unfold dot, minus, scale. simpl. ring. }
    rewrite E in B. apply Rmult_le_reg_l with k; lra. }
  assert (He : 0 <= dot e e) by (rewrite <- norm_sq; pose proof (norm_pos e); nra).
  set (k := Rmin 1 (dot a e / (dot e e + 1))).
  assert (Hq1 : dot a e / (dot e e + 1) * (dot e e + 1) = dot a e) by (field; lra).
  assert (Hq0 : 0 < dot a e / (dot e e + 1)) by (apply Rdiv_lt_0_compat; lra).
  assert (Hk : 0 < k <= 1) by (split; [apply Rmin_glb_lt; lra|apply Rmin_l]).
  assert (Hk2 : k <= dot a e / (dot e e + 1)) by apply Rmin_r.
  specialize (Hstep k Hk). nra.
Qed.

(** The vector from the nearest point changes by at most the displacement of z. *)
Theorem the_rest_is_not_longer C nearest x y :
  convex C -> nearest_of C nearest ->
  norm (minus (minus x (nearest x)) (minus y (nearest y))) <= norm (minus x y).
Proof.
  intros HC HP.
  pose proof (behind_the_nearest_point C nearest x (nearest y) HC HP (proj1 (HP y))) as A.
  pose proof (behind_the_nearest_point C nearest y (nearest x) HC HP (proj1 (HP x))) as B.
  apply norm_le; [apply norm_pos|]. rewrite norm_sq.
  set (e := minus (nearest x) (nearest y)).
  assert (He : 0 <= dot e e) by (rewrite <- norm_sq; pose proof (norm_pos e); nra).
  set (u := minus (minus x (nearest x)) (minus y (nearest y))).
  assert (E : dot (minus x y) (minus x y) = dot u u + 2 * dot u e + dot e e).
  { unfold u, e. destruct x, y, (nearest _), (nearest _). unfold dot, minus. simpl. ring. }
  assert (F : dot u e = - dot (minus x (nearest x)) (minus (nearest y) (nearest x))
                        - dot (minus y (nearest y)) (minus (nearest x) (nearest y))).
  { unfold u, e. destruct x, y, (nearest _), (nearest _). unfold dot, minus. simpl. ring. }
  lra.
Qed.

(** ** The guarantee. *)

(** An obstacle to which the clearance [clear] is kept. The robot may use up the whole slack. *)
Definition an_obstacle (S : braking_setting) (nearest : vec -> vec) (clear : R) (r : robot) : near :=
  Near (fun t => minus (front r t) (nearest (front r t))) 0 (2 * Lambda S) clear.

Definition clearance (nearest : vec -> vec) (r : robot) (t : R) : R :=
  norm (minus (front r t) (nearest (front r t))).

Lemma an_obstacle_moves_beside S C nearest clear r :
  sensible S -> convex C -> nearest_of C nearest -> moves_beside r (an_obstacle S nearest clear r).
Proof.
  intros [_ [HL _]] HC HP. split; [simpl; lra|]. split; [simpl; lra|].
  intros s t Hst. simpl. rewrite Rmult_0_l, Rplus_0_r.
  apply (the_rest_is_not_longer C); assumption.
Qed.

Lemma clearance_continuous (V : R) C nearest r clear :
  0 <= V -> moves r -> never_faster_than V r -> convex C -> nearest_of C nearest ->
  continuous_from_0 (fun t => clearance nearest r t - clear).
Proof.
  intros HV Mr Vr HC HP t Ht e He.
  assert (Hlip : forall a b, 0 <= a <= b ->
            Rabs (clearance nearest r b - clearance nearest r a) <= V * (b - a)).
  { intros a b Hab.
    pose proof (the_rest_is_not_longer C nearest (front r b) (front r a) HC HP) as B.
    assert (M : norm (minus (front r b) (front r a)) <= V * (b - a)).
    { apply front_moves_at_most; [exact Mr|exact HV|exact Hab|]. intros x Hx. apply Vr. lra. }
    unfold clearance. set (u := minus (front r b) (nearest (front r b))) in *.
    set (w := minus (front r a) (nearest (front r a))) in *.
    pose proof (norm_triangle u w). pose proof (norm_triangle w u) as T.
    rewrite (norm_minus_sym w u) in T. apply Rabs_le. lra. }
  exists (e / (V + 1)). split; [apply Rdiv_lt_0_compat; lra|].
  intros s Hs Hst.
  assert (B : V * Rabs (s - t) < e).
  { assert (X : (V + 1) * Rabs (s - t) < e).
    { replace e with ((V + 1) * (e / (V + 1))) by (field; lra).
      apply Rmult_lt_compat_l; [lra|exact Hst]. }
    pose proof (Rabs_pos (s - t)). lra. }
  replace (clearance nearest r s - clear - (clearance nearest r t - clear))
    with (clearance nearest r s - clearance nearest r t) by ring.
  destruct (Rle_lt_dec t s) as [Hts|Hts].
  - pose proof (Hlip t s ltac:(lra)) as L. rewrite (Rabs_pos_eq (s - t)) in B by lra. lra.
  - pose proof (Hlip s t ltac:(lra)) as L.
    rewrite Rabs_minus_sym in L. rewrite (Rabs_left (s - t)) in B by lra. lra.
Qed.

(** The distance to an obstacle decreases at most at the speed at which the robot moves towards its nearest
    point. *)
Lemma clearance_falls_at_most (S : braking_setting) C nearest clear r t g :
  moves r -> convex C -> nearest_of C nearest ->
  keeps_its_share_of S r (an_obstacle S nearest clear r) ->
  0 <= t -> 0 < clearance nearest r t ->
  running_max (E_of (fun x => clearance nearest r x - clear) (2 * Lambda S)) t g ->
  rises_at (fun x => clearance nearest r x - clear) t
    (- (2 * Lambda S) * exp (- (2 * Lambda S) * t) * g).
Proof.
  intros Mr HC HP Hshare Ht Hdist Hg.
  pose proof (Hshare t g Ht Hdist Hg) as B. simpl in B.
  set (z := minus (front r t) (nearest (front r t))) in *.
  assert (Ez : norm z = clearance nearest r t) by reflexivity.
  set (n := scale (/ norm z) z) in *.
  assert (Hunit : norm n = 1).
  { unfold n. rewrite norm_scale by (left; apply Rinv_0_lt_compat; lra). field. lra. }
  (* Along the direction n at time t, the obstacle is no nearer than its true distance. *)
  set (f := fun x => fst n * fst (front r x) + snd n * snd (front r x)).
  assert (Hf : forall x, f x = dot n (front r x)) by reflexivity.
  assert (Hbelow : forall x, f x - dot n (nearest (front r t)) <= clearance nearest r x).
  { intros x. rewrite Hf.
    pose proof (behind_the_nearest_point C nearest (front r t) (nearest (front r x)) HC HP
                  (proj1 (HP (front r x)))) as H1. fold z in H1.
    assert (H2 : dot n (minus (nearest (front r x)) (nearest (front r t))) <= 0).
    { unfold n. rewrite scale_dot.
      assert (0 < / norm z) by (apply Rinv_0_lt_compat; lra). nra. }
    pose proof (dot_le_norms n (minus (front r x) (nearest (front r x)))) as H3.
    rewrite Hunit in H3. fold (clearance nearest r x) in H3.
    rewrite dot_minus in H2, H3. lra. }
  assert (Hequal : f t - dot n (nearest (front r t)) = clearance nearest r t).
  { rewrite Hf, <- dot_minus. fold z. unfold n. rewrite scale_dot, <- norm_sq. rewrite <- Ez.
    field. lra. }
  destruct Mr as [_ [_ [_ [_ Dr]]]]. destruct (Dr t Ht) as [_ [Dx Dy]].
  assert (Hrise : rises_at f t (- (2 * Lambda S) * exp (- (2 * Lambda S) * t) * g)).
  { apply rises_of_right_derivative with
      (fst n * fst (front_velocity r t) + snd n * snd (front_velocity r t)).
    - apply (right_derivative_combination (fun x => fst (front r x)) (fun x => snd (front r x)));
        assumption.
    - unfold dot in B. lra. }
  intros e He. destruct (Hrise e He) as [del [Hdel Hstep]].
  exists del. split; [exact Hdel|]. intros h Hh. specialize (Hstep h Hh).
  specialize (Hbelow (t + h)). lra.
Qed.

Theorem the_clearance_is_kept (S : braking_setting) (r : robot) (C : vec -> Prop) (nearest : vec -> vec) (clear : R) :
  sensible S -> moves r -> never_faster_than (v_max S) r ->
  convex C -> nearest_of C nearest -> 0 < clear ->
  keeps_its_share_of S r (an_obstacle S nearest clear r) ->
  clear <= clearance nearest r 0 ->
  forall t, 0 <= t -> clear <= clearance nearest r t.
Proof.
  intros HS Mr Vr HC HP Hclear Hshare Hstart t Ht. pose proof HS as [HH [HL [HV _]]].
  set (rho := fun x => clearance nearest r x - clear).
  assert (HE : E_of rho (2 * Lambda S) 0 <= E_of rho (2 * Lambda S) t).
  { apply (core_slack rho (2 * Lambda S) clear); [lra|exact Hclear|unfold rho; lra| | |lra].
    - apply (clearance_continuous (v_max S) C); assumption.
    - intros u g Hu Hg Hhigh. apply (clearance_falls_at_most S C); try assumption.
      unfold rho in Hhigh. lra. }
  unfold E_of in HE. rewrite Rmult_0_r, exp_0, Rmult_1_l in HE.
  pose proof (exp_pos (2 * Lambda S * t)) as P. unfold rho in HE.
  destruct (Rle_lt_dec clear (clearance nearest r t)) as [|Hlt]; [assumption|exfalso].
  assert (exp (2 * Lambda S * t) * (clearance nearest r t - clear) < 0) by nra. lra.
Qed.

Theorem no_braking_robot_comes_nearer_to_an_obstacle (S : braking_setting) (N : vec -> R) (tau : R)
    (all : near -> Prop) (r : robot) (C : vec -> Prop) (nearest : vec -> vec) (clear : R) :
  sensible S -> brakes S N tau all r ->
  convex C -> nearest_of C nearest -> 0 < clear -> all (an_obstacle S nearest clear r) ->
  clear <= clearance nearest r 0 ->
  forall t, 0 <= t -> clear <= clearance nearest r t.
Proof.
  intros HS Hr HC HP Hclear Hall Hstart.
  apply (the_clearance_is_kept S r C); try assumption; try apply Hr.
  apply (share_of_the_slack_with_inertia S N tau r all); try assumption.
  - apply (an_obstacle_moves_beside S C); assumption.
  - unfold its_slack. simpl. unfold clearance in Hstart. lra.
Qed.
