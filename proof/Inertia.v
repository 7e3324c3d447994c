(** Robots with inertia: a guard that brakes keeps the same promise. The code does not have this guard
    yet; what is proven here is its argument.

    Wheels now approach what is commanded: the twist moves on the straight segment towards the command
    in force, and towards 0 on its ray, which takes at most its braking time. A certificate covers every
    twist that can be on the way - the one at the sample, the commands alive, the new one - for the
    lifetime H and the braking time tau_o after it. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard.
Open Scope R_scope.

(** ** mu: how much less may be granted because braking takes time. *)

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

(** Braking loses speed no faster than the slack may shrink. *)
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

Definition state (r : robot) (t : R) : vec := (v r t, ell r * w r t).
Definition twist_of (r : robot) (c : command) : vec := (speed c, ell r * turn c).
Definition zero : vec := (0, 0).

(** What the wheels approach: the command in force, else 0. *)
Definition target (H : R) (r : robot) (t : R) : vec :=
  match in_force H (mail r) t with Some c => twist_of r c | None => zero end.

(** The time it takes to brake from y with the accelerations a (of v) and aw (of ell w). *)
Definition braking_time (a aw : R) (y : vec) : R := Rmax (Rabs (fst y) / a) (Rabs (snd y) / aw).

(** P2: the twist moves on the segment towards the target, or a part of it, at any rate.
    P3: while the target is 0, it shrinks on its ray, and its braking time at least as fast as time
    passes. *)
Definition approaches (H a aw : R) (r : robot) : Prop :=
  0 < a /\ 0 < aw /\
  continuous_from_0 (v r) /\ continuous_from_0 (w r) /\
  (forall t, 0 <= t -> exists del, 0 < del /\ forall h, 0 < h < del ->
     exists sigma lam, 0 <= sigma <= 1 /\ 0 <= lam <= 1 /\
     state r (t + h) = plus (scale (1 - sigma) (state r t)) (scale (sigma * lam) (target H r t))) /\
  (forall t1 t2, 0 <= t1 <= t2 -> (forall x, t1 <= x < t2 -> target H r x = zero) ->
     exists lam, 0 <= lam <= 1 /\ state r t2 = scale lam (state r t1) /\
     lam * braking_time a aw (state r t1) <= Rmax 0 (braking_time a aw (state r t1) - (t2 - t1))).

Lemma min_continuous f c : continuous_from_0 f -> continuous_from_0 (fun t => Rmin (f t) c).
Proof.
  intros Hf t Ht e He. destruct (Hf t Ht e He) as [del [Hdel N]].
  exists del. split; [exact Hdel|]. intros s Hs Hst. specialize (N s Hs Hst).
  apply Rabs_def2 in N.
  unfold Rmin. destruct (Rle_dec (f s) c), (Rle_dec (f t) c); apply Rabs_def1; lra.
Qed.

(** The twist does not leave a half-plane that it is in and that contains 0 and all targets. *)
Lemma stays_in_half_plane (H a aw : R) (r : robot) (L : vec) (b s t : R) :
  approaches H a aw r -> 0 <= s <= t -> 0 <= b ->
  - b <= dot L (state r s) ->
  (forall x, s <= x < t -> - b <= dot L (target H r x)) ->
  - b <= dot L (state r t).
Proof.
  intros [_ [_ [Cv [Cw [Hstep _]]]]] Hst Hb Hs Htargets.
  set (f := fun x => dot L (state r x)).
  assert (Cf : continuous_from_0 f).
  { pose proof (continuous_combination (v r) (w r) (fst L) (snd L * ell r) Cv Cw) as C.
    intros x Hx e He. destruct (C x Hx e He) as [del [Hdel N]].
    exists del. split; [exact Hdel|]. intros x' Hx' Hxx. specialize (N x' Hx' Hxx).
    unfold f, dot, state. simpl.
    replace (fst L * v r x' + snd L * (ell r * w r x') - (fst L * v r x + snd L * (ell r * w r x)))
      with (fst L * v r x' + snd L * ell r * w r x' - (fst L * v r x + snd L * ell r * w r x))
      by ring. exact N. }
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

(** ** The last command that moves, and what can act after its sample. *)

Definition stands (c : command) : Prop := speed c = 0 /\ turn c = 0.

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

(** The command k alone, or one computed before it and alive at its sample, or none that moves. *)
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

(** ** The certificate. *)

(** Lambda is free; the guard takes 1 / (H + tau) with the largest braking time tau. *)
Record braking_setting := BrakingSetting {
  lifetime : R;
  Lambda : R;
  v_max : R;
  d : R
}.

Definition sensible (S : braking_setting) : Prop :=
  0 < lifetime S /\ 0 < Lambda S /\ 0 <= v_max S /\ 0 < d S.

(** b *)
Definition braking_bound (S : braking_setting) (v_own tau_o rho : R) : R :=
  Lambda S * mu (2 * Lambda S * tau_o)
  * Rmax (exp (-2 * Lambda S * lifetime S) * Rmax rho 0) (rho - (v_own + v_max S) * lifetime S).

(** For every twist that may be in force, and be braked from: at most v_own, braked in tau_o, turning
    between w_low and w_high; and slower than b towards the other, whatever its direction and the own
    heading until then. [z] is own minus other at the sample. *)
Definition fits (S : braking_setting) (a aw v_own tau_o w_low w_high ell : R) (y : vec) : Prop :=
  norm y <= v_own /\ braking_time a aw y <= tau_o /\ ell * w_low <= snd y <= ell * w_high.

Definition certified_against (S : braking_setting) (v_own tau_o w_low w_high theta : R) (z y : vec)
  : Prop :=
  let h := lifetime S + tau_o / 2 in
  let M := v_own * h + v_max S * (lifetime S + tau_o) in
  let b := braking_bound S v_own tau_o (norm z - d S) in
  v_own <= b \/
  exists n, dot n n = 1 /\ z = scale (norm z) n /\
    forall x,
      - psi (spread h w_low w_high 0) (swing M (norm z)) <= x
        <= psi (spread h w_low w_high 0) (swing M (norm z)) ->
      - b <= dot (rotate x n) (rotate (middle theta h w_low w_high) y).

(** How a twist Y (turned into the middle heading) can be tested against the whole cone at once. *)
Theorem one_test_for_the_cone (n Y : vec) (b Psi alpha : R) :
  0 <= Psi -> - PI <= alpha <= PI -> Y = scale (norm Y) (rotate alpha n) -> dot n n = 1 ->
  - b <= norm Y * cos (Rmin PI (Rabs alpha + Psi)) ->
  forall x, - Psi <= x <= Psi -> - b <= dot (rotate x n) Y.
Proof.
  intros HP Ha HY Hn Htest x Hx.
  assert (E : dot (rotate x n) Y = norm Y * cos (Rabs (alpha - x))).
  { rewrite HY at 1. rewrite dot_scale, <- (rotate_dot (- x)), !rotate_rotate.
    rewrite Rplus_opp_l, rotate_0. replace (- x + alpha) with (alpha - x) by ring.
    assert (C : cos (Rabs (alpha - x)) = cos (alpha - x)).
    { unfold Rabs. destruct (Rcase_abs (alpha - x)); [apply cos_neg|reflexivity]. }
    rewrite C. f_equal. destruct n as [n1 n2]. unfold dot, rotate in *; simpl in *.
    transitivity ((n1 * n1 + n2 * n2) * cos (alpha - x)); [ring|rewrite Hn; ring]. }
  rewrite E. eapply Rle_trans; [exact Htest|].
  apply Rmult_le_compat_l; [apply norm_pos|].
  assert (Hax : Rabs (alpha - x) <= Rabs alpha + Psi).
  { unfold Rabs. destruct (Rcase_abs (alpha - x)), (Rcase_abs alpha); lra. }
  pose proof (Rabs_pos (alpha - x)). pose proof (Rabs_pos alpha).
  destruct (Rle_lt_dec PI (Rabs alpha + Psi)) as [Hbig|Hsmall].
  - rewrite Rmin_left by exact Hbig. rewrite cos_PI. apply COS_bound.
  - rewrite Rmin_right by lra. apply cos_decr_1; lra.
Qed.

(** Command k stands, or this holds of 0, of the twist at the sample, of the commands alive, and of
    itself. *)
Definition certified (S : braking_setting) (a aw : R) (r : robot) (others : robot -> Prop) (k : nat)
  : Prop :=
  let c := computed r k in
  let s := stamp c in
  stands c \/
  exists v_own tau_o w_low w_high,
    0 <= v_own <= v_max S /\ 0 < tau_o /\ w_low <= 0 <= w_high /\
    forall y,
      y = zero \/ y = state r s \/ y = twist_of r c \/
      (exists l, (l < k)%nat /\ s < stamp (computed r l) + lifetime S /\ y = twist_of r (computed r l)) ->
      fits S a aw v_own tau_o w_low w_high (ell r) y /\
      forall o, others o ->
        certified_against S v_own tau_o w_low w_high (heading r s) (minus (front r s) (front o s)) y.

(** ** How far a robot gets while it brakes. *)

Lemma goes_at_most_while_braking (f l : R -> R) (L tau s t : R) :
  continuous_from_0 f -> 0 <= s <= t -> 0 < tau -> 0 <= L ->
  (forall x, s <= x < t -> right_derivative f x (l x) /\ l x <= L * Rmax 0 (1 - (x - s) / tau)) ->
  f t - f s <= L * tau / 2.
Proof.
  intros Hc Hst Htau HL Hd.
  (* Up to u, when it stands, and from there on. *)
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

(** ** At every instant, no more than half of the slack. *)

(** All that one robot must fulfil. P1 is the plant's rule for commands, as without inertia. *)
Definition brakes (S : braking_setting) (a aw : R) (others : robot -> Prop) (r : robot) : Prop :=
  moves r /\ approaches (lifetime S) a aw r /\ state r 0 = zero /\
  never_faster_than (v_max S) r /\
  chronological (mail r) /\ one_living_incarnation (computed r) /\
  sent_by (computed r) (mail r) /\
  forall k, 0 <= stamp (computed r k) /\ certified S a aw r others k.

Lemma target_of_none_that_moves H r t :
  (forall c, in_force H (mail r) t = Some c -> stands c) -> target H r t = zero.
Proof.
  intros Hc. unfold target. destruct (in_force H (mail r) t) as [c|]; [|reflexivity].
  destruct (Hc c eq_refl) as [S1 S2]. unfold twist_of, zero. rewrite S1, S2. f_equal. ring.
Qed.

Lemma norm_zero : norm zero = 0.
Proof.
  unfold norm, dot, zero; simpl. replace (0 * 0 + 0 * 0) with 0 by ring. apply sqrt_0.
Qed.

Lemma scale_zero k : scale k zero = zero.
Proof. unfold scale, zero; simpl. f_equal; ring. Qed.

(** Whatever fits is closed under what the plant does on the way. *)
Lemma fits_on_the_way S a aw v_own tau_o lo hi l (K : vec -> Prop) y :
  0 < a -> 0 < aw -> 0 < l -> 0 <= v_own -> 0 < tau_o -> lo <= 0 <= hi ->
  (forall y, K y -> fits S a aw v_own tau_o lo hi l y) ->
  (forall L b, 0 <= b -> (forall y, K y -> - b <= dot L y) -> - b <= dot L y) ->
  fits S a aw v_own tau_o lo hi l y.
Proof.
  intros Ha Haw Hl Hv Htau Hlh HK Hinv.
  assert (Hfst : forall q z c, 0 < q -> Rabs z / q <= c -> - (q * c) <= z <= q * c).
  { intros q z c Hq Hz. apply Rabs_le_between. apply Rmult_le_reg_r with (/ q).
    - apply Rinv_0_lt_compat. exact Hq.
    - apply Rle_trans with c; [exact Hz|]. right. field. lra. }
  assert (Hbt : forall y, K y -> - (a * tau_o) <= fst y <= a * tau_o /\
                               - (aw * tau_o) <= snd y <= aw * tau_o).
  { intros y' Hy. destruct (HK y' Hy) as [_ [B _]]. unfold braking_time in B.
    split; apply Hfst; try assumption; eapply Rle_trans; try exact B; [apply Rmax_l|apply Rmax_r]. }
  assert (Pa : 0 <= a * tau_o) by (apply Rmult_le_pos; lra).
  assert (Pw : 0 <= aw * tau_o) by (apply Rmult_le_pos; lra).
  assert (Plo : 0 <= - (l * lo)) by nra. assert (Phi : 0 <= l * hi) by nra.
  assert (Hval : forall p q b, 0 <= b -> (forall y, K y -> - b <= p * fst y + q * snd y) ->
                 - b <= p * fst y + q * snd y).
  { intros p q b Hb Hall. apply (Hinv (p, q) b Hb). intros y' Hy. exact (Hall y' Hy). }
  assert (F1 := Hval 1 0 (a * tau_o) Pa ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
  assert (F2 := Hval (-1) 0 (a * tau_o) Pa ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
  assert (F3 := Hval 0 1 (aw * tau_o) Pw ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
  assert (F4 := Hval 0 (-1) (aw * tau_o) Pw ltac:(intros y' Hy; destruct (Hbt y' Hy); lra)).
  assert (F5 := Hval 0 1 (- (l * lo)) Plo
                  ltac:(intros y' Hy; destruct (HK y' Hy) as [_ [_ B]]; lra)).
  assert (F6 := Hval 0 (-1) (l * hi) Phi
                  ltac:(intros y' Hy; destruct (HK y' Hy) as [_ [_ B]]; lra)).
  split; [|split; [|lra]].
  - pose proof (norm_pos y) as P. pose proof (norm_sq y) as Q.
    assert (B : - (norm y * v_own) <= dot (scale (-1) y) y).
    { apply Hinv; [apply Rmult_le_pos; assumption|]. intros y' Hy.
      destruct (HK y' Hy) as [N _]. rewrite scale_dot.
      pose proof (dot_le_norms y y') as C.
      assert (norm y * norm y' <= norm y * v_own) by (apply Rmult_le_compat_l; assumption). lra. }
    rewrite scale_dot, <- Q in B.
    destruct (Rle_lt_dec (norm y) v_own) as [|Hgt]; [assumption|nra].
  - assert (Hquot : forall q z, 0 < q -> - (q * tau_o) <= z <= q * tau_o -> Rabs z / q <= tau_o).
    { intros q z Hq Hz. apply Rmult_le_reg_r with q; [exact Hq|]. unfold Rdiv.
      rewrite Rmult_assoc, Rinv_l, Rmult_1_r by lra. apply Rabs_le. lra. }
    unfold braking_time. apply Rmax_lub; apply Hquot; lra.
Qed.

(** After the last target that moves, the twist shrinks as fast as the certificate reckons. *)
Lemma shrinks_on_its_ray H a aw r t1 t2 tau_o :
  approaches H a aw r -> 0 <= t1 <= t2 -> 0 < tau_o ->
  (forall x, t1 <= x < t2 -> target H r x = zero) ->
  braking_time a aw (state r t1) <= tau_o ->
  exists lam, 0 <= lam <= Rmax 0 (1 - (t2 - t1) / tau_o) /\ state r t2 = scale lam (state r t1).
Proof.
  intros Happ Ht Htau Hzero HN.
  pose proof Happ as [Ha [Haw [_ [_ [_ Hray]]]]].
  destruct (Hray t1 t2 Ht Hzero) as [lam [Hlam [E B]]].
  set (N := braking_time a aw (state r t1)) in *.
  assert (HN0 : 0 <= N).
  { unfold N, braking_time. eapply Rle_trans; [|apply Rmax_l].
    apply Rdiv_le_0_compat; [apply Rabs_pos|exact Ha]. }
  set (y := (t2 - t1) / tau_o).
  assert (Hy : t2 - t1 = y * tau_o) by (unfold y; field; lra).
  assert (Hy0 : 0 <= y) by (unfold y; apply Rdiv_le_0_compat; lra).
  destruct (Rle_lt_or_eq_dec 0 N HN0) as [Hpos|H0].
  - exists lam. split; [|exact E]. split; [lra|].
    destruct (Rle_lt_dec N (t2 - t1)) as [Hlong|Hshort].
    + rewrite (Rmax_left 0 (N - (t2 - t1))) in B by lra.
      assert (lam = 0) by nra. subst lam. apply Rmax_l.
    + rewrite (Rmax_right 0 (N - (t2 - t1))) in B by lra.
      eapply Rle_trans; [|apply Rmax_r].
      (* lam <= 1 - (t2 - t1) / N <= 1 - (t2 - t1) / tau_o *)
      rewrite Hy in B. apply Rmult_le_reg_r with N; [exact Hpos|].
      assert (y * N <= y * tau_o) by (apply Rmult_le_compat_l; assumption). lra.
  - exists 0. split; [split; [lra|apply Rmax_l]|].
    assert (Hst : state r t1 = zero).
    { assert (Rabs (fst (state r t1)) / a <= 0).
      { rewrite H0. unfold N, braking_time. apply Rmax_l. }
      assert (Rabs (snd (state r t1)) / aw <= 0).
      { rewrite H0. unfold N, braking_time. apply Rmax_r. }
      assert (Hz : forall q z, 0 < q -> Rabs z / q <= 0 -> z = 0).
      { intros q z Hq Hz. assert (Rabs z <= 0).
        { apply Rmult_le_reg_r with (/ q); [apply Rinv_0_lt_compat; exact Hq|]. lra. }
        apply Rabs_eq_0. pose proof (Rabs_pos z). lra. }
      destruct (state r t1) as [p q]. simpl in *. unfold zero. f_equal; [apply (Hz a)|apply (Hz aw)]; assumption. }
    rewrite E, Hst, !scale_zero. reflexivity.
Qed.

Theorem share_of_the_slack_with_inertia (S : braking_setting) (a aw : R) (r o : robot)
    (others : robot -> Prop) :
  sensible S -> brakes S a aw others r -> others o ->
  moves o -> never_faster_than (v_max S) o -> 0 <= rho (d S) r o 0 ->
  keeps_its_share (Lambda S) (d S) r o.
Proof.
  intros [HH [HL [HV Hd]]] [Mr [Happ [Hrest [Vr [Hchron [Hone [Hsent Hall]]]]]]] Ho Mo Vo Hstart.
  intros t g Ht Hdist Hg.
  set (L := Lambda S) in *. set (k2 := 2 * L) in *.
  assert (Hg0 : 0 <= g).
  { apply Rle_trans with (E_of (rho (d S) r o) k2 0); [|apply (proj1 Hg); lra].
    unfold E_of. rewrite Rmult_0_r, exp_0. lra. }
  assert (Hslack : forall s, 0 <= s <= t -> Rmax (rho (d S) r o s) 0 <= exp (- k2 * s) * g).
  { intros s Hs. apply Rmax_lub.
    - pose proof (proj1 Hg s Hs) as B. unfold E_of in B.
      apply Rmult_le_reg_l with (exp (k2 * s)); [apply exp_pos|].
      rewrite <- Rmult_assoc, <- exp_plus. replace (k2 * s + - k2 * s) with 0 by ring.
      rewrite exp_0. lra.
    - apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]. }
  set (n := direction r o t).
  change (front_velocity r t) with (rotate (heading r t) (state r t)).
  assert (Hzero : 0 <= L * (exp (- k2 * t) * g)).
  { apply Rmult_le_pos; [lra|]. apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]. }
  assert (Henough : forall b, b <= L * (exp (- k2 * t) * g) ->
            - b <= dot n (rotate (heading r t) (state r t)) ->
            - (L * exp (- k2 * t) * g) <= dot n (rotate (heading r t) (state r t))).
  { intros b Hb Hdot. lra. }
  assert (Hstill : state r t = zero ->
            - (L * exp (- k2 * t) * g) <= dot n (rotate (heading r t) (state r t))).
  { intros E. apply (Henough 0); [lra|]. rewrite E. unfold rotate, zero, dot; simpl. lra. }
  destruct (what_acts_since_the_last_sample (lifetime S) r t Hchron Hone Hsent HH)
    as [Hnone|[k [Hmov [Hst [Hmay Hlater]]]]].
  { (* nothing has moved it yet *)
    pose proof Happ as [_ [_ [_ [_ [_ Hray]]]]].
    destruct (Hray 0 t ltac:(lra)) as [lam [_ [E _]]].
    { intros x Hx. apply target_of_none_that_moves. intros c Hc. apply (Hnone x c); [lra|exact Hc]. }
    apply Hstill. rewrite E, Hrest. apply scale_zero. }
  destruct (Hall k) as [Hs0 [Hstands|[v_own [tau_o [lo [hi [Hown [Htau [Hlh HK]]]]]]]]];
    [contradiction|].
  set (c := computed r k) in *. set (s := stamp c) in *.
  set (K := fun y => y = zero \/ y = state r s \/ y = twist_of r c \/
      (exists l, (l < k)%nat /\ s < stamp (computed r l) + lifetime S
                 /\ y = twist_of r (computed r l))).
  change (forall y, K y -> fits S a aw v_own tau_o lo hi (ell r) y /\
            forall o, others o ->
              certified_against S v_own tau_o lo hi (heading r s) (minus (front r s) (front o s)) y)
    in HK.
  pose proof Mr as [Hell [Ch [_ [_ Hdr]]]].
  pose proof Happ as [Ha [Haw _]].
  (* targets and twists since the sample *)
  assert (Htarget : forall x, s <= x <= t -> K (target (lifetime S) r x)).
  { intros x Hx. unfold target.
    destruct (in_force (lifetime S) (mail r) x) as [c'|] eqn:E; [|left; reflexivity].
    destruct (Hmay x c' Hx E) as [[S1 S2]|[->|[l [Hlk [-> Hal]]]]].
    - left. unfold twist_of, zero. rewrite S1, S2. f_equal. ring.
    - right. right. left. reflexivity.
    - right. right. right. exists l. auto. }
  assert (Hinv : forall x, s <= x <= t -> forall M b, 0 <= b ->
            (forall y, K y -> - b <= dot M y) -> - b <= dot M (state r x)).
  { intros x Hx M b Hb HM.
    apply (stays_in_half_plane (lifetime S) a aw r M b s x Happ); [lra|exact Hb| |].
    - apply HM. right. left. reflexivity.
    - intros x' Hx'. apply HM. apply Htarget. lra. }
  assert (Hfits : forall x, s <= x <= t -> fits S a aw v_own tau_o lo hi (ell r) (state r x)).
  { intros x Hx. apply (fits_on_the_way S a aw v_own tau_o lo hi (ell r) K); try assumption; try lra.
    - intros y Hy. apply (HK y Hy).
    - apply Hinv. exact Hx. }
  assert (Hw : forall x, s <= x <= t -> lo <= w r x <= hi).
  { intros x Hx. destruct (Hfits x Hx) as [_ [_ B]]. unfold state in B; simpl in B.
    split; apply Rmult_le_reg_l with (ell r); lra. }
  set (t1 := s + lifetime S) in *.
  assert (Et1 : t1 = s + lifetime S) by reflexivity.
  assert (Hshrink : forall x, t1 <= x <= t ->
            exists lam, 0 <= lam <= Rmax 0 (1 - (x - t1) / tau_o) /\
                        state r x = scale lam (state r t1)).
  { intros x Hx. apply (shrinks_on_its_ray (lifetime S) a aw); [exact Happ|lra|exact Htau| |].
    - intros x' Hx'. apply target_of_none_that_moves. intros c' Hc'.
      apply (Hlater x' c'); [lra|exact Hc'].
    - apply (Hfits t1). lra. }
  (* standing for good *)
  destruct (Rle_lt_dec t (t1 + tau_o)) as [Hsoon|Hlate].
  2: { destruct (Hshrink t ltac:(lra)) as [lam [Hlam E]].
       assert (1 < (t - t1) / tau_o).
       { apply Rmult_lt_reg_r with tau_o; [exact Htau|]. unfold Rdiv.
         rewrite Rmult_assoc, Rinv_l; lra. }
       rewrite Rmax_left in Hlam by lra. apply Hstill. rewrite E.
       replace lam with 0 by lra. unfold scale, zero. f_equal; ring. }
  set (h := lifetime S + tau_o / 2).
  set (z := minus (front r t) (front o t)).
  set (zs := minus (front r s) (front o s)).
  assert (Hown_early : forall x, s <= x <= t -> x <= t1 ->
            norm (minus (front r x) (front r s)) <= v_own * (x - s)).
  { intros x Hx Hx1. apply front_moves_at_most; [exact Mr|lra|lra|].
    intros x' Hx'. apply (Hfits x'). lra. }
  assert (Hown_moved : norm (minus (front r t) (front r s)) <= v_own * h).
  { destruct (Rle_lt_dec t t1) as [Hearly|Hbraking].
    - pose proof (Hown_early t ltac:(lra) Hearly) as B. unfold h.
      assert (v_own * (t - s) <= v_own * (lifetime S + tau_o / 2))
        by (apply Rmult_le_compat_l; lra). lra.
    - pose proof (Hown_early t1 ltac:(lra) ltac:(lra)) as B.
      assert (C : norm (minus (front r t) (front r t1)) <= v_own * tau_o / 2).
      { apply front_moves_while_braking; [exact Mr|lra|exact Htau|lra|].
        intros x Hx. destruct (Hshrink x ltac:(lra)) as [lam [Hlam E]].
        rewrite E, norm_scale by lra. destruct (Hfits t1 ltac:(lra)) as [N _].
        pose proof (norm_pos (state r t1)). rewrite Rmult_comm.
        apply Rmult_le_compat; lra. }
      assert (T : norm (minus (front r t) (front r s))
                  <= norm (minus (front r t) (front r t1)) + norm (minus (front r t1) (front r s))).
      { replace (minus (front r t) (front r s))
          with (plus (minus (front r t) (front r t1)) (minus (front r t1) (front r s)));
          [apply norm_plus|].
        unfold plus, minus. simpl. f_equal; ring. }
      unfold h. unfold t1 in B at 2. lra. }
  assert (Hother : forall x, s <= x <= t ->
            norm (minus (front o x) (front o s)) <= v_max S * (x - s)).
  { intros x Hx. apply front_moves_at_most; [exact Mo|exact HV|lra|].
    intros x' Hx'. apply Vo. lra. }
  assert (Hrel : forall x A B, s <= x <= t ->
            norm (minus (front r x) (front r s)) <= A -> v_max S * (x - s) <= B ->
            norm (minus (minus (front r x) (front o x)) zs) <= A + B).
  { intros x A B Hx HA HB. pose proof (Hother x Hx) as HO.
    assert (T : norm (minus (minus (front r x) (front o x)) zs)
                <= norm (minus (front r x) (front r s)) + norm (minus (front o s) (front o x))).
    { replace (minus (minus (front r x) (front o x)) zs)
        with (plus (minus (front r x) (front r s)) (minus (front o s) (front o x)));
        [apply norm_plus|].
      unfold zs, plus, minus. simpl. f_equal; ring. }
    rewrite (norm_minus_sym (front o s)) in T. lra. }
  set (M := v_own * h + v_max S * (lifetime S + tau_o)).
  assert (Hmoved : norm (minus z zs) <= M).
  { apply (Hrel t); [lra|exact Hown_moved|]. apply Rmult_le_compat_l; [exact HV|].
    lra. }
  assert (Hturned : h * lo <= heading r t - heading r s <= h * hi).
  { assert (Hearly : forall x, s <= x <= t -> x <= t1 ->
              lo * (x - s) <= heading r x - heading r s <= hi * (x - s)).
    { intros x Hx Hx1. apply heading_turns_within; [exact Mr|lra|].
      intros x' Hx'. apply Hw. lra. }
    destruct (Rle_lt_dec t t1) as [Ht1|Hbraking].
    - pose proof (Hearly t ltac:(lra) Ht1) as B.
      assert (lo * h <= lo * (t - s)) by (apply Rmult_le_compat_neg_l; unfold h; lra).
      assert (hi * (t - s) <= hi * h) by (apply Rmult_le_compat_l; unfold h; lra). lra.
    - pose proof (Hearly t1 ltac:(lra) ltac:(lra)) as B.
      assert (Hlam : forall x, t1 <= x < t ->
                lo * Rmax 0 (1 - (x - t1) / tau_o) <= w r x <= hi * Rmax 0 (1 - (x - t1) / tau_o)).
      { intros x Hx. destruct (Hshrink x ltac:(lra)) as [lam [Hl E]].
        assert (Ew : w r x = lam * w r t1).
        { unfold state, scale in E. simpl in E. injection E as _ E.
          apply Rmult_eq_reg_l with (ell r); lra. }
        pose proof (Hw t1 ltac:(lra)) as W. rewrite Ew.
        set (q := Rmax 0 (1 - (x - t1) / tau_o)) in *. split; nra. }
      assert (C1 : heading r t - heading r t1 <= hi * tau_o / 2).
      { apply (goes_at_most_while_braking _ (w r)); [exact Ch|lra|exact Htau|lra|].
        intros x Hx. split; [apply Hdr; lra|apply Hlam; exact Hx]. }
      assert (C2 : (-1 * heading r t + 0 * heading r t) - (-1 * heading r t1 + 0 * heading r t1)
                   <= (- lo) * tau_o / 2).
      { apply (goes_at_most_while_braking (fun x => -1 * heading r x + 0 * heading r x)
                 (fun x => -1 * w r x + 0 * w r x));
          [apply continuous_combination; exact Ch|lra|exact Htau|lra|].
        intros x Hx. specialize (Hlam x Hx). split; [|lra].
        apply right_derivative_combination; apply Hdr; lra. }
      replace (t1 - s) with (lifetime S) in B by (unfold t1; ring). unfold h. lra. }
  (* the certificate, for the direction and heading as they are now *)
  set (b := braking_bound S v_own tau_o (norm zs - d S)).
  set (beta := Rmax (exp (-2 * Lambda S * lifetime S) * Rmax (norm zs - d S) 0)
                    (norm zs - d S - (v_own + v_max S) * lifetime S)).
  fold L in beta.
  assert (Hbeta0 : 0 <= beta).
  { eapply Rle_trans; [|apply Rmax_l].
    apply Rmult_le_pos; [left; apply exp_pos|apply Rmax_r]. }
  pose proof (mu_range (k2 * tau_o)) as Hmu.
  assert (Eb : b = L * mu (k2 * tau_o) * beta) by reflexivity.
  assert (Hb0 : 0 <= b).
  { rewrite Eb. apply Rmult_le_pos; [apply Rmult_le_pos; lra|exact Hbeta0]. }
  assert (Hh : 0 < h) by (unfold h; lra).
  assert (HM : 0 <= M).
  { unfold M. assert (0 <= v_own * h) by (apply Rmult_le_pos; lra).
    assert (0 <= v_max S * (lifetime S + tau_o)) by (apply Rmult_le_pos; lra). lra. }
  assert (Hunit : norm n = 1).
  { unfold n, direction. rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hdist).
    unfold distance. field. unfold distance in Hdist. lra. }
  assert (Hcert : forall y, K y -> - b <= dot n (rotate (heading r t) y)).
  { intros y Hy. destruct (HK y Hy) as [[N _] Hagainst].
    specialize (Hagainst o Ho). unfold certified_against in Hagainst. cbv zeta in Hagainst.
    fold zs in Hagainst. fold h in Hagainst. fold M in Hagainst. fold b in Hagainst.
    destruct Hagainst as [Hskip|[m [Hm [Ezs Hcone]]]].
    - pose proof (dot_ge_norms n (rotate (heading r t) y)) as B.
      rewrite Hunit, rotate_norm in B. lra.
    - assert (Hspr : 0 <= spread h lo hi 0).
      { unfold spread. assert (0 <= h * (hi - lo)) by (apply Rmult_le_pos; lra). lra. }
      destruct (truth_is_in_the_cone m z (norm zs) M (middle (heading r s) h lo hi)
                  (spread h lo hi 0) (heading r t) Hm HM Hspr Hdist) as [x [Hx Ex]].
      + rewrite <- Ezs. exact Hmoved.
      + unfold middle, spread. lra.
      + unfold n, direction. unfold distance. fold z. rewrite Ex. apply Hcone. exact Hx. }
  assert (Hfun : forall x, s <= x <= t -> - b <= dot n (rotate (heading r t) (state r x))).
  { intros x Hx. rewrite dot_comm, dot_rotate, dot_comm.
    apply (Hinv x Hx); [exact Hb0|].
    intros y Hy. rewrite dot_comm. rewrite <- (dot_rotate (heading r t) y n), dot_comm.
    apply Hcert. exact Hy. }
  (* what b is worth at the end of the lifetime, or now *)
  assert (Hworth : forall x, s <= x <= t -> x <= t1 -> beta <= exp (- k2 * x) * g).
  { intros x Hx Hx1. apply Rmax_lub.
    - pose proof (Hslack s ltac:(lra)) as B. unfold rho, distance in B. fold zs in B.
      apply Rle_trans with (exp (-2 * L * lifetime S) * (exp (- k2 * s) * g)).
      + apply Rmult_le_compat_l; [left; apply exp_pos|exact B].
      + rewrite <- Rmult_assoc, <- exp_plus. apply Rmult_le_compat_r; [exact Hg0|].
        assert (Hexp : -2 * L * lifetime S + - k2 * s <= - k2 * x).
        { assert (X : L * (x - s) <= L * lifetime S)
            by (apply Rmult_le_compat_l; lra).
          unfold k2. lra. }
        destruct (Rle_lt_or_eq_dec _ _ Hexp) as [Hlt|Heq];
          [left; apply exp_increasing; exact Hlt|right; rewrite Heq; reflexivity].
    - apply Rle_trans with (Rmax (rho (d S) r o x) 0); [|apply Hslack; lra].
      eapply Rle_trans; [|apply Rmax_l].
      assert (v_own * (x - s) <= v_own * lifetime S)
        by (apply Rmult_le_compat_l; lra).
      assert (v_max S * (x - s) <= v_max S * lifetime S)
        by (apply Rmult_le_compat_l; lra).
      pose proof (Hown_early x Hx Hx1) as B.
      pose proof (Hrel x (v_own * lifetime S) (v_max S * lifetime S) Hx ltac:(lra) ltac:(lra)) as C.
      pose proof (norm_triangle zs (minus (front r x) (front o x))) as T.
      rewrite (norm_minus_sym zs) in T. unfold rho, distance. lra. }
  destruct (Rle_lt_dec t t1) as [Hearly|Hbraking].
  - apply (Henough b); [|apply Hfun; lra].
    rewrite Eb. pose proof (Hworth t ltac:(lra) Hearly) as B.
    assert (mu (k2 * tau_o) * beta <= 1 * beta) by (apply Rmult_le_compat_r; lra).
    rewrite Rmult_assoc. apply Rmult_le_compat_l; lra.
  - destruct (Hshrink t ltac:(lra)) as [lam [Hlam E]].
    pose proof (Hfun t1 ltac:(lra)) as B.
    set (q := Rmax 0 (1 - (t - t1) / tau_o)) in *.
    apply (Henough (q * b)).
    + pose proof (Hworth t1 ltac:(lra) ltac:(lra)) as W.
      pose proof (braking_keeps_up k2 tau_o (t - t1) ltac:(unfold k2; lra) Htau ltac:(lra)) as U.
      fold q in U. rewrite Eb.
      replace (q * (L * mu (k2 * tau_o) * beta)) with (L * (q * mu (k2 * tau_o) * beta)) by ring.
      apply Rmult_le_compat_l; [lra|].
      apply Rle_trans with (exp (- k2 * (t - t1)) * (exp (- k2 * t1) * g)).
      * apply Rmult_le_compat; [|exact Hbeta0|exact U|exact W].
        apply Rmult_le_pos; [apply Rmax_l|lra].
      * right. rewrite <- Rmult_assoc, <- exp_plus. f_equal. f_equal. ring.
    + rewrite E, rotate_scale, dot_scale.
      assert (lam * - b <= lam * dot n (rotate (heading r t) (state r t1)))
        by (apply Rmult_le_compat_l; lra).
      assert (lam * b <= q * b) by (apply Rmult_le_compat_r; lra). lra.
Qed.

(** ** The promise, with inertia. *)

Theorem no_two_braking_robots_are_ever_nearer_than_d (I : Type) (S : braking_setting)
    (a aw : I -> R) (robots : I -> robot) :
  sensible S ->
  (forall i, brakes S (a i) (aw i) (fun o => exists j, j <> i /\ o = robots j) (robots i)) ->
  (forall i j, i <> j -> d S <= distance (robots i) (robots j) 0) ->
  forall i j t, i <> j -> 0 <= t -> d S <= distance (robots i) (robots j) t.
Proof.
  intros HS G Hstart i j t Hij Ht. pose proof HS as [HH [HL [HV Hd]]].
  assert (Hshare : forall p q, p <> q -> keeps_its_share (Lambda S) (d S) (robots p) (robots q)).
  { intros p q Hpq. apply (share_of_the_slack_with_inertia S (a p) (aw p) _ _ _ HS (G p)).
    - exists q. auto.
    - apply (G q).
    - apply (G q).
    - unfold rho. pose proof (Hstart p q Hpq). lra. }
  apply (E_keeps_the_distance (2 * Lambda S)); [|apply Hstart; exact Hij].
  apply (two_shares_keep_E_from_falling _ _ (v_max S)); try assumption; try lra.
  - apply (G i).
  - apply (G j).
  - apply (G i).
  - apply (G j).
  - apply Hshare. exact Hij.
  - apply Hshare. auto.
  - apply Hstart. exact Hij.
Qed.

(** ** Without mu the argument fails. *)

(** With braking time 1 s and k = 2 / s: after half a second half of the speed is left, but only
    1/e of the slack need be. *)
Theorem without_mu_braking_does_not_keep_up :
  exp (- 2 * (1 / 2)) < Rmax 0 (1 - 1 / 2 / 1).
Proof.
  rewrite Rmax_right by lra.
  replace (- 2 * (1 / 2)) with (- (1)) by field. rewrite exp_Ropp.
  assert (E : 1 + 1 < exp 1) by (apply exp_ineq1; lra).
  apply Rlt_le_trans with (/ 2); [apply Rinv_lt_contravar; lra|lra].
Qed.
