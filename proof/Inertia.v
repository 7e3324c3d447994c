(** Robots with inertia: how the wheels follow the commands, which commands can be in effect after a sample, and
    how far a robot moves while it brakes.

    The twist moves on the straight segment towards the command in force, and towards 0 on its ray, which takes
    at most its braking time. Or its two components change independently, each towards its target. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard.
Open Scope R_scope.

(** ** The factor mu: reduction of the permitted speed because braking takes time. *)

Definition mu (x : R) : R := if Rle_dec x 1 then 1 else x * exp (1 - x).

Lemma mu_range x : 0 < mu x <= 1.
Proof.
  unfold mu. destruct (Rle_dec x 1); [lra|].
  assert (Hx : 0 < x) by lra. split.
  - apply Rmult_lt_0_compat; [exact Hx|apply exp_pos].
  - pose proof (exp_ineq1_le (x - 1)) as E.
    replace (1 - x) with (- (x - 1)) by ring. rewrite exp_Ropp.
    apply Rmult_le_reg_r with (exp (x - 1)); [apply exp_pos|].
    rewrite Rmult_assoc, Rinv_l by (pose proof (exp_pos (x - 1)); lra). lra.
Qed.

Lemma mu_falls x y : 0 <= x <= y -> mu y <= mu x.
Proof.
  intros Hxy. unfold mu at 2. destruct (Rle_dec x 1) as [Hx|Hx]; [apply mu_range|].
  unfold mu. destruct (Rle_dec y 1) as [Hy|Hy]; [lra|].
  (* y <= x (1 + (y - x)) <= x e^(y - x) *)
  pose proof (exp_ineq1_le (y - x)) as E.
  replace (1 - x) with ((y - x) + (1 - y)) by ring. rewrite exp_plus.
  pose proof (exp_pos (1 - y)) as P.
  rewrite <- Rmult_assoc. apply Rmult_le_compat_r; [lra|].
  apply Rle_trans with (x * (1 + (y - x))); [nra|]. apply Rmult_le_compat_l; lra.
Qed.

(** Braking reduces the speed at least as fast as the slack may shrink. *)
Theorem braking_keeps_up (k tau x : R) :
  0 <= k -> 0 < tau -> 0 <= x ->
  Rmax 0 (1 - x / tau) * mu (k * tau) <= exp (- k * x).
Proof.
  intros Hk Htau Hx.
  destruct (Rle_lt_dec tau x) as [Hlong|Hshort].
  { rewrite Rmax_left; [rewrite Rmult_0_l; left; apply exp_pos|].
    assert (1 <= x / tau).
    { apply Rmult_le_reg_r with tau; [exact Htau|]. unfold Rdiv.
      rewrite Rmult_assoc, Rinv_l; lra. }
    lra. }
  assert (Hy : 0 <= x / tau < 1).
  { split; [apply Rdiv_le_0_compat; lra|]. apply Rmult_lt_reg_r with tau; [exact Htau|].
    unfold Rdiv. rewrite Rmult_assoc, Rinv_l; lra. }
  rewrite Rmax_right by lra.
  set (y := x / tau) in *. assert (Hxy : x = y * tau) by (unfold y; field; lra).
  set (a := k * tau). assert (Ha : 0 <= a) by (apply Rmult_le_pos; lra).
  replace (- k * x) with (- (a * y)) by (unfold a; rewrite Hxy; ring).
  unfold mu. destruct (Rle_dec a 1) as [H1|H1].
  - (* 1 - y <= 1 - a y <= e^(-a y) *)
    pose proof (exp_ineq1_le (- (a * y))). nra.
  - (* with z = a (1 - y): z <= e^(z - 1) *)
    pose proof (exp_ineq1_le (a * (1 - y) - 1)) as E.
    replace (- (a * y)) with ((a * (1 - y) - 1) + (1 - a)) by ring. rewrite exp_plus.
    pose proof (exp_pos (1 - a)). nra.
Qed.

(** ** The plant with inertia. *)

Definition state (r : robot) (t : R) : vec := (v r t, side r t).
Definition twist_of (r : robot) (c : command) : vec := (speed c, across c).
Definition zero : vec := (0, 0).

(** Target of the wheels: the command in force, or 0 without one. *)
Definition target (H : R) (r : robot) (t : R) : vec :=
  match in_force H (mail r) t with Some c => twist_of r c | None => zero end.

(** A measure of the braking time (gauge): the twists that brake within a time are an intersection of half-planes that
    contain 0. [within_hull]: the twist satisfies every such half-plane that all twists in [K] satisfy. *)
Definition within_hull (K : vec -> Prop) (y : vec) : Prop :=
  forall L b, 0 <= b -> (forall k, K k -> - b <= dot L k) -> - b <= dot L y.
Definition gauge (N : vec -> R) : Prop :=
  (forall y, 0 <= N y) /\ (forall y, N y = 0 -> y = zero) /\
  (forall (K : vec -> Prop) y c, 0 <= c -> (forall k, K k -> N k <= c) -> within_hull K y -> N y <= c).

(** P2: the twist moves on the segment towards the target, or towards a fraction of it, at any rate. P3: while
    the target is 0, the twist shrinks on its ray, and its braking time decreases at least as fast as time
    passes. *)
Definition approaches (H : R) (N : vec -> R) (r : robot) : Prop :=
  gauge N /\
  continuous_from_0 (v r) /\ continuous_from_0 (side r) /\
  (forall t, 0 <= t -> exists del, 0 < del /\ forall h, 0 < h < del ->
     exists sigma lam, 0 <= sigma <= 1 /\ 0 <= lam <= 1 /\
     state r (t + h) = plus (scale (1 - sigma) (state r t)) (scale (sigma * lam) (target H r t))) /\
  (forall t1 t2, 0 <= t1 <= t2 -> (forall x, t1 <= x < t2 -> target H r x = zero) ->
     exists lam, 0 <= lam <= 1 /\ state r t2 = scale lam (state r t1) /\
     lam * N (state r t1) <= Rmax 0 (N (state r t1) - (t2 - t1))).

(** The twist is in the rectangle, with sides along and across the heading, from [low] to [high]; it is one of its four
    corners. *)
Definition in_rectangle (low high y : vec) : Prop :=
  fst low <= fst y <= fst high /\ snd low <= snd y <= snd high.
Definition corner (low high y : vec) : Prop :=
  (fst y = fst low \/ fst y = fst high) /\ (snd y = snd low \/ snd y = snd high).

(** The components of the twist change independently. P2: each stays between 0, its value and its targets, that is, the
    twist stays in every rectangle that contains 0, the twist and all targets. P3: while the target is 0, each
    component shrinks, at least in proportion to the braking time that is left: [each_in_its_own_time]. *)
Definition approaches_on_each_axis (H : R) (N : vec -> R) (r : robot) : Prop :=
  gauge N /\
  (forall s t low high, 0 <= s <= t -> in_rectangle low high zero -> in_rectangle low high (state r s) ->
     (forall x, s <= x <= t -> in_rectangle low high (target H r x)) -> in_rectangle low high (state r t)) /\
  (forall t1 t2, 0 <= t1 <= t2 -> (forall x, t1 <= x < t2 -> target H r x = zero) ->
     exists l1 l2, 0 <= l1 <= 1 /\ 0 <= l2 <= 1 /\ state r t2 = (l1 * v r t1, l2 * side r t1) /\
     Rmax l1 l2 * N (state r t1) <= Rmax 0 (N (state r t1) - (t2 - t1))).

Lemma min_continuous f c : continuous_from_0 f -> continuous_from_0 (fun t => Rmin (f t) c).
Proof.
  intros Hf t Ht e He. destruct (Hf t Ht e He) as [del [Hdel N]].
  exists del. split; [exact Hdel|]. intros s Hs Hst. specialize (N s Hs Hst).
  apply Rabs_def2 in N.
  unfold Rmin. destruct (Rle_dec (f s) c), (Rle_dec (f t) c); apply Rabs_def1; lra.
Qed.

(** The twist does not leave a half-plane that contains it, 0 and all targets. *)
Lemma stays_in_half_plane (H : R) (N : vec -> R) (r : robot) (L : vec) (b s t : R) :
  approaches H N r -> 0 <= s <= t -> 0 <= b ->
  - b <= dot L (state r s) ->
  (forall x, s <= x < t -> - b <= dot L (target H r x)) ->
  - b <= dot L (state r t).
Proof.
  intros [_ [Cv [Cw [Hstep _]]]] Hst Hb Hs Htargets.
  set (f := fun x => dot L (state r x)).
  assert (Cf : continuous_from_0 f).
  { exact (continuous_combination (v r) (side r) (fst L) (snd L) Cv Cw). }
  assert (Hm : Rmin (f s) (- b) <= Rmin (f t) (- b)).
  { apply (never_falls (fun x => Rmin (f x) (- b))); [apply min_continuous; exact Cf|exact Hst|].
    intros x Hx e He. destruct (Hstep x ltac:(lra)) as [del [Hdel Hh]].
    exists del. split; [exact Hdel|]. intros h Hhd.
    destruct (Hh h Hhd) as [sigma [lam [Hsig [Hlam E]]]].
    assert (Hnow : f (x + h) = (1 - sigma) * f x + sigma * (lam * dot L (target H r x))).
    { unfold f. rewrite E. destruct L, (state r x), (target H r x).
      unfold dot, plus, scale; simpl. ring. }
    specialize (Htargets x Hx).
    assert (Hl : - b <= lam * dot L (target H r x)) by nra.
    assert (Hge : Rmin (f x) (- b) <= f (x + h)).
    { rewrite Hnow. pose proof (Rmin_l (f x) (- b)). pose proof (Rmin_r (f x) (- b)).
      assert ((1 - sigma) * Rmin (f x) (- b) <= (1 - sigma) * f x) by (apply Rmult_le_compat_l; lra).
      assert (sigma * Rmin (f x) (- b) <= sigma * (lam * dot L (target H r x)))
        by (apply Rmult_le_compat_l; lra).
      lra. }
    apply Rle_trans with (Rmin (f x) (- b)); [nra|]. apply Rmin_glb; [exact Hge|apply Rmin_r]. }
  rewrite Rmin_right in Hm by exact Hs.
  pose proof (Rmin_l (f t) (- b)). unfold f in *. lra.
Qed.

(** ** The last command that moves the robot, and the commands that can be in effect after its sample. *)

Definition stands (c : command) : Prop := speed c = 0 /\ across c = 0 /\ turn c = 0.

Lemma last_moving H m n :
  (forall j c, (j <= n)%nat -> newest H m j = Some c -> stands c) \/
  exists n0 c0, (n0 <= n)%nat /\ newest H m n0 = Some c0 /\ ~ stands c0 /\
    forall j c, (n0 <= j <= n)%nat -> newest H m j = Some c -> c = c0 \/ stands c.
Proof.
  induction n as [|n IH].
  { left. intros j c Hj Hc. replace j with 0%nat in Hc by lia. discriminate. }
  destruct (newest H m (S n)) as [c1|] eqn:E.
  - destruct (Classical_Prop.classic (stands c1)) as [Hst|Hmov].
    + destruct IH as [Hall|[n0 [c0 [Hn0 [Hc0 [Hm0 Hafter]]]]]].
      * left. intros j c Hj Hc. destruct (Nat.eq_dec j (S n)) as [->|Hne].
        -- rewrite E in Hc. injection Hc as <-. exact Hst.
        -- apply (Hall j); [lia|exact Hc].
      * right. exists n0, c0. repeat split; try assumption; [lia|].
        intros j c Hj Hc. destruct (Nat.eq_dec j (S n)) as [->|Hne].
        -- rewrite E in Hc. injection Hc as <-. right. exact Hst.
        -- apply (Hafter j); [lia|exact Hc].
    + right. exists (S n), c1. repeat split; try assumption; [lia|].
      intros j c Hj Hc. replace j with (S n) in Hc by lia. rewrite E in Hc.
      injection Hc as <-. left. reflexivity.
  - left. intros j c Hj Hc.
    destruct (newest_only_grows H m j (S n) c ltac:(lia) Hc) as [c' [E' _]].
    rewrite E in E'. discriminate.
Qed.

(** Command k alone, or one computed before it and unexpired at its sample, or none that moves the robot. *)
Definition may_act_since (H : R) (r : robot) (k : nat) (c : command) : Prop :=
  stands c \/ c = computed r k \/
  exists l, (l < k)%nat /\ c = computed r l /\ stamp (computed r k) < stamp (computed r l) + H.

Theorem what_acts_since_the_last_sample (H : R) (r : robot) (t : R) :
  chronological (mail r) -> one_living_incarnation (computed r) -> sent_by (computed r) (mail r) ->
  0 < H ->
  (forall x c, x <= t -> in_force H (mail r) x = Some c -> stands c) \/
  exists k, ~ stands (computed r k) /\ stamp (computed r k) <= t /\
    (forall x c, stamp (computed r k) <= x <= t -> in_force H (mail r) x = Some c ->
       may_act_since H r k c) /\
    (forall x c, stamp (computed r k) + H <= x <= t -> in_force H (mail r) x = Some c -> stands c).
Proof.
  intros Hchron Hone Hsent HH.
  destruct (last_moving H (mail r) (Plant.count (mail r) t))
    as [Hall|[n0 [c0 [Hn0 [Hc0 [Hmov Hafter]]]]]].
  - left. intros x c Hx Hc. unfold in_force in Hc.
    destruct (newest H (mail r) (Plant.count (mail r) x)) as [c1|] eqn:E; [|discriminate].
    destruct (Rlt_dec x (stamp c1 + H)); [|discriminate]. injection Hc as ->.
    apply (Hall (Plant.count (mail r) x)); [|exact E]. apply count_only_grows; assumption.
  - right.
    destruct (newest_was_taken H (mail r) n0 c0 Hc0) as [k0 [Hk0 [Hmsg Htaken]]].
    destruct (Hsent k0) as [k Hk]. rewrite Hk in Hmsg. subst c0. clear Hk.
    assert (Ht : taken (mail r) k0 <= t) by (apply Hchron; lia).
    exists k. split; [exact Hmov|]. split; [lra|].
    assert (Hmain : forall x c, stamp (computed r k) <= x <= t ->
              in_force H (mail r) x = Some c -> may_act_since H r k c).
    { intros x c Hx Hc.
      destruct (acts_within_its_lifetime H (mail r) x c Hchron Hc) as [Hlife _].
      unfold in_force in Hc.
      destruct (newest H (mail r) (Plant.count (mail r) x)) as [c1|] eqn:E; [|discriminate].
      destruct (Rlt_dec x (stamp c1 + H)); [|discriminate]. injection Hc as ->.
      pose proof (count_only_grows (mail r) x t Hchron (proj2 Hx)) as Hcount.
      destruct (Compare_dec.le_lt_dec n0 (Plant.count (mail r) x)) as [Hge|Hlt].
      - destruct (Hafter (Plant.count (mail r) x) c ltac:(lia) E) as [->|Hs].
        + right. left. reflexivity.
        + left. exact Hs.
      - destruct (newest_only_grows H (mail r) (Plant.count (mail r) x) n0 c ltac:(lia) E) as [c' [E' B]].
        rewrite Hc0 in E'. injection E' as <-.
        destruct B as [->|B]; [right; left; reflexivity|].
        destruct (newest_was_taken H (mail r) _ c E) as [j [_ [Hj _]]].
        destruct (Hsent j) as [l Hl]. rewrite Hl in Hj. subst c. clear Hl.
        right. right. exists l.
        destruct (Compare_dec.lt_eq_lt_dec l k) as [[Hlk| ->]|Hgt].
        + split; [exact Hlk|]. split; [reflexivity|lra].
        + exfalso. apply (before_irrefl _ B).
        + exfalso. destruct (Hone k l Hgt) as [B' _].
          apply (before_irrefl (computed r k)). apply (before_trans _ (computed r l)); assumption. }
    split; [exact Hmain|].
    intros x c Hx Hc.
    destruct (acts_within_its_lifetime H (mail r) x c Hchron Hc) as [Hlife _].
    destruct (Hmain x c ltac:(lra) Hc) as [Hs|[->|[l [Hlk [-> _]]]]]; [exact Hs|exfalso; lra|].
    exfalso. destruct (Hone l k Hlk) as [_ Hle]. lra.
Qed.

(** ** Maximum displacement of a robot while it brakes. *)

Lemma goes_at_most_while_braking (f l : R -> R) (L tau s t : R) :
  continuous_from_0 f -> 0 <= s <= t -> 0 < tau -> 0 <= L ->
  (forall x, s <= x < t -> right_derivative f x (l x) /\ l x <= L * Rmax 0 (1 - (x - s) / tau)) ->
  f t - f s <= L * tau / 2.
Proof.
  intros Hc Hst Htau HL Hd.
  (* Up to u, when it comes to rest, and after that. *)
  set (u := Rmin t (s + tau)).
  assert (Hu : s <= u <= t) by (split; [apply Rmin_glb; lra|apply Rmin_l]).
  assert (Hus : u <= s + tau) by apply Rmin_r.
  assert (Hquot : forall x, (x - s) / tau * tau = x - s) by (intros; field; lra).
  set (p := fun x => L * ((x - s) - (x - s) * (x - s) / (2 * tau))).
  assert (Dp : forall x, is_derive p x (L * (1 - (x - s) / tau))).
  { intros x. unfold p. auto_derive; [exact I|]. field. lra. }
  assert (H1 : f u - f s <= p u - p s).
  { assert (X : 1 * p s + -1 * f s <= 1 * p u + -1 * f u).
    { apply (never_falls (fun x => 1 * p x + -1 * f x)).
      - apply continuous_combination; [|exact Hc].
        apply continuous_of_continuity. intros x.
        apply derivable_continuous_pt. exists (L * (1 - (x - s) / tau)).
        apply is_derive_Reals. apply Dp.
      - lra.
      - intros x Hx. destruct (Hd x ltac:(lra)) as [D Hl].
        apply rises_of_right_derivative with (1 * (L * (1 - (x - s) / tau)) + -1 * l x).
        + apply right_derivative_combination; [apply right_derivative_of_is_derive, Dp|exact D].
        + rewrite Rmax_right in Hl; [lra|].
          assert ((x - s) / tau <= 1).
          { apply Rmult_le_reg_r with tau; [exact Htau|]. rewrite Hquot. lra. }
          lra. }
    lra. }
  assert (H2 : f t - f u <= 0 * (t - u)).
  { apply (goes_at_most f l 0); [exact Hc|lra|]. intros x Hx.
    destruct (Hd x ltac:(lra)) as [D Hl]. split; [exact D|].
    assert (Hut : u = s + tau).
    { unfold u, Rmin in *. destruct (Rle_dec t (s + tau)); lra. }
    rewrite Rmax_left in Hl; [lra|].
    assert (1 <= (x - s) / tau).
    { apply Rmult_le_reg_r with tau; [exact Htau|]. rewrite Hquot. lra. }
    lra. }
  assert (H3 : p u - p s <= L * tau / 2).
  { unfold p. replace (s - s) with 0 by ring.
    assert (Q : 0 <= (u - s - tau) * (u - s - tau)) by apply Rle_0_sqr.
    assert (E : L * (u - s - (u - s) * (u - s) / (2 * tau)) - L * (0 - 0 * 0 / (2 * tau))
                = L * tau / 2 - L * ((u - s - tau) * (u - s - tau)) / (2 * tau)) by (field; lra).
    rewrite E.
    assert (0 <= L * ((u - s - tau) * (u - s - tau)) / (2 * tau)).
    { apply Rdiv_le_0_compat; [apply Rmult_le_pos; assumption|lra]. }
    lra. }
  lra.
Qed.

Lemma front_moves_while_braking (r : robot) (V tau s t : R) :
  moves r -> 0 <= V -> 0 < tau -> 0 <= s <= t ->
  (forall x, s <= x < t -> norm (state r x) <= V * Rmax 0 (1 - (x - s) / tau)) ->
  norm (minus (front r t) (front r s)) <= V * tau / 2.
Proof.
  intros [_ [_ [Cx [Cy Hd]]]] HV Htau Hst Hspeed.
  set (D := minus (front r t) (front r s)).
  assert (H : dot D D <= norm D * V * tau / 2).
  { replace (dot D D) with (fst D * fst (front r t) + snd D * snd (front r t)
                            - (fst D * fst (front r s) + snd D * snd (front r s)))
      by (unfold D, dot, minus; simpl; ring).
    apply (goes_at_most_while_braking
             (fun x => fst D * fst (front r x) + snd D * snd (front r x))
             (fun x => fst D * fst (front_velocity r x) + snd D * snd (front_velocity r x)));
      [apply continuous_combination; assumption|exact Hst|exact Htau| |].
    - apply Rmult_le_pos; [apply norm_pos|exact HV].
    - intros x Hx. destruct (Hd x ltac:(lra)) as [_ [Dx Dy]]. split.
      + apply right_derivative_combination; assumption.
      + change (dot D (front_velocity r x) <= norm D * V * Rmax 0 (1 - (x - s) / tau)).
        pose proof (dot_le_norms D (front_velocity r x)) as B.
        unfold front_velocity in B at 2. rewrite rotate_norm in B. fold (state r x) in B.
        specialize (Hspeed x Hx). pose proof (norm_pos D).
        assert (norm D * norm (state r x) <= norm D * (V * Rmax 0 (1 - (x - s) / tau)))
          by (apply Rmult_le_compat_l; lra). lra. }
  rewrite <- norm_sq in H. pose proof (norm_pos D) as P.
  destruct (Rle_lt_or_eq_dec 0 (norm D) P) as [Hpos|H0].
  - apply Rmult_le_reg_l with (norm D); [exact Hpos|]. lra.
  - rewrite <- H0. assert (0 <= V * tau) by (apply Rmult_le_pos; lra). lra.
Qed.

(** ** Twists within the bounds. *)

(** The twist has a speed of at most v_own and a braking time of at most tau_o. *)
Definition fits (N : vec -> R) (v_own tau_o : R) (y : vec) : Prop := norm y <= v_own /\ N y <= tau_o.

(** The turn rate stays between 0, its value at the start, and the turn rates of the commands in force. *)
Definition turns_between (H : R) (r : robot) : Prop :=
  forall s t lo hi, 0 <= s <= t -> lo <= 0 <= hi -> lo <= w r s <= hi ->
  (forall x c, s <= x <= t -> in_force H (mail r) x = Some c -> lo <= turn c <= hi) ->
  lo <= w r t <= hi.

Lemma target_of_none_that_moves H r t :
  (forall c, in_force H (mail r) t = Some c -> stands c) -> target H r t = zero.
Proof.
  intros Hc. unfold target. destruct (in_force H (mail r) t) as [c|]; [|reflexivity].
  destruct (Hc c eq_refl) as [S1 [S2 _]]. unfold twist_of, zero. rewrite S1, S2. reflexivity.
Qed.

Lemma norm_zero : norm zero = 0.
Proof.
  unfold norm, dot, zero; simpl. replace (0 * 0 + 0 * 0) with 0 by ring. apply sqrt_0.
Qed.

Lemma scale_zero k : scale k zero = zero.
Proof. unfold scale, zero; simpl. f_equal; ring. Qed.

(** A half-plane that contains the four corners contains the rectangle. *)
Lemma corners_bound_the_rectangle (low high y L : vec) (b : R) :
  (forall k, corner low high k -> - b <= dot L k) -> in_rectangle low high y -> - b <= dot L y.
Proof.
  intros Hk [[X1 X2] [Y1 Y2]].
  assert (Hend : forall p l h x, l <= x <= h -> exists e, (e = l \/ e = h) /\ p * e <= p * x).
  { intros p l h x Hx. destruct (Rle_lt_dec 0 p).
    - exists l. split; [left; reflexivity|]. apply Rmult_le_compat_l; lra.
    - exists h. split; [right; reflexivity|]. apply Rmult_le_compat_neg_l; lra. }
  destruct (Hend (fst L) _ _ _ (conj X1 X2)) as [e1 [E1 B1]].
  destruct (Hend (snd L) _ _ _ (conj Y1 Y2)) as [e2 [E2 B2]].
  specialize (Hk (e1, e2) (conj E1 E2)). unfold dot in *. simpl in Hk. lra.
Qed.

(** The set of twists within the bounds is closed under the plant's motion between commands. *)
Lemma norm_within_hull (K : vec -> Prop) y v_own :
  0 <= v_own -> (forall k, K k -> norm k <= v_own) -> within_hull K y -> norm y <= v_own.
Proof.
  intros Hv HK Hinv. pose proof (norm_pos y) as P. pose proof (norm_sq y) as Q.
  assert (B : - (norm y * v_own) <= dot (scale (-1) y) y).
  { apply Hinv; [apply Rmult_le_pos; assumption|]. intros y' Hy.
    pose proof (HK y' Hy) as M. rewrite scale_dot. pose proof (dot_le_norms y y') as C.
    assert (norm y * norm y' <= norm y * v_own) by (apply Rmult_le_compat_l; assumption). lra. }
  rewrite scale_dot, <- Q in B.
  destruct (Rle_lt_dec (norm y) v_own) as [|Hgt]; [assumption|nra].
Qed.

Lemma fits_on_the_way N v_own tau_o (K : vec -> Prop) y :
  gauge N -> 0 <= v_own -> 0 < tau_o ->
  (forall y, K y -> fits N v_own tau_o y) -> within_hull K y -> fits N v_own tau_o y.
Proof.
  intros [_ [_ Hg]] Hv Htau HK Hinv. split.
  - apply (norm_within_hull K); [exact Hv| |exact Hinv]. intros k Hk. apply (HK k Hk).
  - apply (Hg K); [lra| |exact Hinv]. intros k Hk. apply (HK k Hk).
Qed.

(** Braking time of omnidirectional wheels, and of drones at a fixed height: the same acceleration in each direction. *)
Theorem isotropic a : 0 < a -> gauge (fun y => norm y / a).
Proof.
  intros Ha. assert (Hi : 0 < / a) by (apply Rinv_0_lt_compat; exact Ha). split; [|split].
  - intros y. apply Rdiv_le_0_compat; [apply norm_pos|exact Ha].
  - intros y Hy. assert (norm y = 0).
    { apply Rmult_eq_reg_r with (/ a); [|lra]. rewrite Rmult_0_l. exact Hy. }
    pose proof (norm_sq y) as Q. rewrite H in Q. destruct y as [p q]. unfold dot in Q; simpl in Q.
    unfold zero. f_equal; nra.
  - intros K y c Hc HK Hh. apply Rmult_le_reg_r with a; [exact Ha|].
    replace (norm y / a * a) with (norm y) by (field; lra).
    apply (norm_within_hull K); [apply Rmult_le_pos; lra| |exact Hh]. intros k Hk.
    specialize (HK k Hk). apply Rmult_le_reg_r with (/ a); [exact Hi|].
    replace (c * a * / a) with c by (field; lra). exact HK.
Qed.

(** Time to brake from y with the accelerations a (of v) and aw (of ell w), for differential drives. *)
Definition braking_time (a aw : R) (y : vec) : R := Rmax (Rabs (fst y) / a) (Rabs (snd y) / aw).

Theorem each_axis a aw : 0 < a -> 0 < aw -> gauge (braking_time a aw).
Proof.
  intros Ha Haw. split; [|split].
  - intros y. eapply Rle_trans; [|apply Rmax_l]. apply Rdiv_le_0_compat; [apply Rabs_pos|exact Ha].
  - intros y Hy. assert (Hz : forall q z, 0 < q -> Rabs z / q <= 0 -> z = 0).
    { intros q z Hq Hz. assert (Rabs z <= 0).
      { apply Rmult_le_reg_r with (/ q); [apply Rinv_0_lt_compat; exact Hq|]. lra. }
      apply Rabs_eq_0. pose proof (Rabs_pos z). lra. }
    destruct y as [p q]. simpl in *. unfold zero. f_equal.
    + apply (Hz a); [exact Ha|]. rewrite <- Hy. apply Rmax_l.
    + apply (Hz aw); [exact Haw|]. rewrite <- Hy. apply Rmax_r.
  - intros K y c Hc HK Hinv.
    assert (Hfst : forall q z, 0 < q -> Rabs z / q <= c -> - (q * c) <= z <= q * c).
    { intros q z Hq Hz. apply Rabs_le_between. apply Rmult_le_reg_r with (/ q).
      - apply Rinv_0_lt_compat. exact Hq.
      - apply Rle_trans with c; [exact Hz|]. right. field. lra. }
    assert (Hbt : forall y, K y -> - (a * c) <= fst y <= a * c /\ - (aw * c) <= snd y <= aw * c).
    { intros y' Hy. pose proof (HK y' Hy) as B.
      split; apply Hfst; try assumption; eapply Rle_trans; try exact B; [apply Rmax_l|apply Rmax_r]. }
    assert (Pa : 0 <= a * c) by (apply Rmult_le_pos; lra).
    assert (Pw : 0 <= aw * c) by (apply Rmult_le_pos; lra).
    assert (Hval : forall p q b, 0 <= b -> (forall y, K y -> - b <= p * fst y + q * snd y) ->
                   - b <= p * fst y + q * snd y).
    { intros p q b Hb Hall. apply (Hinv (p, q) b Hb). intros y' Hy. exact (Hall y' Hy). }
    assert (F1 := Hval 1 0 (a * c) Pa ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
    assert (F2 := Hval (-1) 0 (a * c) Pa ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
    assert (F3 := Hval 0 1 (aw * c) Pw ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
    assert (F4 := Hval 0 (-1) (aw * c) Pw ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
    assert (Hquot : forall q z, 0 < q -> - (q * c) <= z <= q * c -> Rabs z / q <= c).
    { intros q z Hq Hz. apply Rmult_le_reg_r with q; [exact Hq|]. unfold Rdiv.
      rewrite Rmult_assoc, Rinv_l, Rmult_1_r by lra. apply Rabs_le. lra. }
    apply Rmax_lub; apply Hquot; lra.
Qed.

(** Components that are at rest after their own braking times, or earlier, satisfy P3 of [approaches_on_each_axis]. *)
Lemma each_in_its_own_time (a aw T l1 l2 : R) (y : vec) :
  0 < a -> 0 < aw -> 0 <= T -> 0 <= l1 <= 1 -> 0 <= l2 <= 1 ->
  l1 * (Rabs (fst y) / a) <= Rmax 0 (Rabs (fst y) / a - T) ->
  l2 * (Rabs (snd y) / aw) <= Rmax 0 (Rabs (snd y) / aw - T) ->
  exists m1 m2, 0 <= m1 <= 1 /\ 0 <= m2 <= 1 /\
    (l1 * fst y, l2 * snd y) = (m1 * fst y, m2 * snd y) /\
    Rmax m1 m2 * braking_time a aw y <= Rmax 0 (braking_time a aw y - T).
Proof.
  intros Ha Haw HT H1 H2 B1 B2. set (n := braking_time a aw y).
  assert (Hone : forall c z l, 0 < c -> 0 <= l <= 1 -> Rabs z / c <= n ->
            l * (Rabs z / c) <= Rmax 0 (Rabs z / c - T) ->
            exists m, 0 <= m <= 1 /\ l * z = m * z /\ m * n <= Rmax 0 (n - T)).
  { intros c z l Hc Hl Hn B. destruct (Req_dec z 0) as [->|Hz].
    - exists 0. split; [lra|]. split; [ring|]. rewrite Rmult_0_l. apply Rmax_l.
    - exists l. split; [exact Hl|]. split; [reflexivity|].
      assert (Hpos : 0 < Rabs z / c) by (apply Rdiv_lt_0_compat; [apply Rabs_pos_lt; exact Hz|exact Hc]).
      set (x := Rabs z / c) in *. pose proof (Rmax_r 0 (n - T)).
      destruct (Rle_lt_dec x T) as [Hrest|Hmoves].
      + rewrite Rmax_left in B by lra. assert (l = 0) by nra. subst l. rewrite Rmult_0_l. apply Rmax_l.
      + rewrite Rmax_right in B by lra. assert (l * (n - x) <= 1 * (n - x)) by (apply Rmult_le_compat_r; lra). lra. }
  destruct (Hone a (fst y) l1 Ha H1 (Rmax_l _ _) B1) as [m1 [M1 [E1 C1]]].
  destruct (Hone aw (snd y) l2 Haw H2 (Rmax_r _ _) B2) as [m2 [M2 [E2 C2]]].
  exists m1, m2. split; [exact M1|]. split; [exact M2|]. split; [rewrite E1, E2; reflexivity|].
  unfold Rmax at 1. destruct (Rle_dec m1 m2); assumption.
Qed.

(** The part that is left, after the time T, of a twist with the braking time n. *)
Lemma part_that_is_left (n lam T tau_o : R) :
  0 < n <= tau_o -> 0 <= lam -> 0 <= T -> lam * n <= Rmax 0 (n - T) -> lam <= Rmax 0 (1 - T / tau_o).
Proof.
  intros Hn Hlam HT B.
  set (y := T / tau_o).
  assert (Hy : T = y * tau_o) by (unfold y; field; lra).
  assert (Hy0 : 0 <= y) by (unfold y; apply Rdiv_le_0_compat; lra).
  destruct (Rle_lt_dec n T) as [Hlong|Hshort].
  - rewrite (Rmax_left 0 (n - T)) in B by lra.
    assert (lam = 0) by nra. subst lam. apply Rmax_l.
  - rewrite (Rmax_right 0 (n - T)) in B by lra.
    eapply Rle_trans; [|apply Rmax_r].
    (* lam <= 1 - T / n <= 1 - T / tau_o *)
    rewrite Hy in B. apply Rmult_le_reg_r with n; [lra|].
    assert (y * n <= y * tau_o) by (apply Rmult_le_compat_l; lra). lra.
Qed.

(** After the last moving target, the twist shrinks at least as fast as the certificate assumes. *)
Lemma shrinks_on_its_ray H N r t1 t2 tau_o :
  approaches H N r -> 0 <= t1 <= t2 -> 0 < tau_o ->
  (forall x, t1 <= x < t2 -> target H r x = zero) ->
  N (state r t1) <= tau_o ->
  exists lam, 0 <= lam <= Rmax 0 (1 - (t2 - t1) / tau_o) /\ state r t2 = scale lam (state r t1).
Proof.
  intros Happ Ht Htau Hzero HN.
  pose proof Happ as [[Gpos [Gzero _]] [_ [_ [_ Hray]]]].
  destruct (Hray t1 t2 Ht Hzero) as [lam [Hlam [E B]]].
  destruct (Rle_lt_or_eq_dec 0 (N (state r t1)) (Gpos _)) as [Hpos|H0].
  - exists lam. split; [|exact E]. split; [lra|].
    apply (part_that_is_left (N (state r t1))); lra.
  - exists 0. split; [split; [lra|apply Rmax_l]|].
    assert (Hst : state r t1 = zero) by (apply Gzero; symmetry; exact H0).
    rewrite E, Hst, !scale_zero. reflexivity.
Qed.

(** The same for components that change independently: the twist is a fraction of one whose components are between 0
    and those at the start. *)
Lemma shrinks_on_each_axis H N r t1 t2 tau_o :
  approaches_on_each_axis H N r -> 0 <= t1 <= t2 -> 0 < tau_o ->
  (forall x, t1 <= x < t2 -> target H r x = zero) ->
  N (state r t1) <= tau_o ->
  exists lam m1 m2, 0 <= lam <= Rmax 0 (1 - (t2 - t1) / tau_o) /\ 0 <= m1 <= 1 /\ 0 <= m2 <= 1 /\
    state r t2 = scale lam (m1 * v r t1, m2 * side r t1).
Proof.
  intros [[Gpos [Gzero _]] [_ Hray]] Ht Htau Hzero HN.
  destruct (Hray t1 t2 Ht Hzero) as [l1 [l2 [H1 [H2 [E B]]]]].
  assert (Hrest : (l1 * v r t1, l2 * side r t1) = zero ->
            exists lam m1 m2, 0 <= lam <= Rmax 0 (1 - (t2 - t1) / tau_o) /\ 0 <= m1 <= 1 /\ 0 <= m2 <= 1 /\
              state r t2 = scale lam (m1 * v r t1, m2 * side r t1)).
  { intros Hz. exists 0, 0, 0. split; [split; [lra|apply Rmax_l]|]. split; [lra|]. split; [lra|].
    rewrite E, Hz. unfold scale, zero; simpl. f_equal; ring. }
  set (lam := Rmax l1 l2) in *.
  assert (L1 : l1 <= lam) by apply Rmax_l. assert (L2 : l2 <= lam) by apply Rmax_r.
  destruct (Rle_lt_or_eq_dec 0 (N (state r t1)) (Gpos _)) as [Hpos|H0].
  - destruct (Rle_lt_dec lam 0) as [Hnone|Hlam].
    { apply Hrest. replace l1 with 0 by lra. replace l2 with 0 by lra. unfold zero. f_equal; ring. }
    assert (Hpart : forall l, 0 <= l <= lam -> 0 <= l / lam <= 1).
    { intros l Hl. split; [apply Rdiv_le_0_compat; lra|]. apply Rmult_le_reg_r with lam; [exact Hlam|].
      unfold Rdiv. rewrite Rmult_assoc, Rinv_l; lra. }
    exists lam, (l1 / lam), (l2 / lam). split; [|split; [apply Hpart; lra|split; [apply Hpart; lra|]]].
    + split; [lra|]. apply (part_that_is_left (N (state r t1))); lra.
    + rewrite E. unfold scale; simpl. f_equal; field; lra.
  - apply Hrest. symmetry in H0. apply Gzero in H0. unfold state, zero in H0. injection H0 as -> ->.
    unfold zero. f_equal; ring.
Qed.

(** ** Without mu the argument fails. *)

(** With braking time 1 s and k = 2 / s, half of the speed is left after half a second, but possibly only 1/e of
    the slack. *)
Theorem without_mu_braking_does_not_keep_up :
  exp (- 2 * (1 / 2)) < Rmax 0 (1 - 1 / 2 / 1).
Proof.
  rewrite Rmax_right by lra.
  replace (- 2 * (1 / 2)) with (- (1)) by field. rewrite exp_Ropp.
  assert (E : 1 + 1 < exp 1) by (apply exp_ineq1; lra).
  apply Rlt_le_trans with (/ 2); [apply Rinv_lt_contravar; lra|lra].
Qed.
