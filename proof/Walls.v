(** A robot that stops at once stays clear of fixed convex obstacles: the guard without inertia, with the whole
    slack for the robot.

    The definitions [wall_bound] and [far_wall] are formulas of `Guard::collect_cones` and `known_walls_radius_m` in
    agent/src/avoidance/guard.rs. A test there compares them. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Time Inertia Braking Obstacles.
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

(** For a fraction of [c], from a heading within the range, when z has moved by at most v_own H. *)
Theorem certificate_holds_beside_a_wall (S : Guard.setting)
    (clear v_own w_low w_high theta theta_t lam : R) (c : command) (z_true z : vec) :
  Guard.sensible S -> 0 <= v_own <= Guard.v_max S -> w_low <= 0 <= w_high ->
  covers v_own w_low w_high c ->
  respects_wall S clear v_own w_low w_high theta c z_true ->
  0 <= lam <= 1 -> 0 < norm z ->
  norm (minus z z_true) <= v_own * Guard.lifetime S ->
  Guard.lifetime S * w_low <= theta_t - theta <= Guard.lifetime S * w_high ->
  exists b,
    - b <= dot (scale (/ norm z) z) (rotate theta_t (scale lam (speed c, across c))) /\
    (b <= 2 * rate (Guard.lifetime S) * (exp (-2) * Rmax (norm z_true - clear) 0) \/
     b <= 2 * rate (Guard.lifetime S) * Rmax (norm z - clear) 0).
Proof.
  intros [HH [HV [Hd [Heps [Heta Hrnd]]]]] Hown Hw [Hcs _] Hresp Hlam Hz Hmoved Hturned.
  set (H := Guard.lifetime S) in *.
  pose proof (rate_pos H HH) as HL. pose proof (rate_times_H H HH) as HLH.
  set (u := rotate theta_t (scale lam (speed c, across c))).
  assert (Hslow : forall b, v_own <= b -> - b <= dot (scale (/ norm z) z) u).
  { intros b Hb. pose proof (dot_ge_norms (scale (/ norm z) z) u) as B.
    assert (E1 : norm (scale (/ norm z) z) = 1).
    { rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hz). field. lra. }
    assert (E2 : norm u <= v_own).
    { unfold u. rewrite rotate_norm, norm_scale by lra.
      pose proof (norm_pos (speed c, across c)). nra. }
    rewrite E1 in B. lra. }
  pose proof (norm_triangle z_true z) as Hfar. rewrite norm_minus_sym in Hfar.
  destruct Hresp as [Hunsensed | [r [n [theta_s [Hr [Hn [Herr [Htheta Hcase]]]]]]]].
  - unfold far_wall in Hunsensed. fold H in Hunsensed.
    exists (2 * rate H * Rmax (norm z - clear) 0). split; [|right; lra].
    apply Hslow.
    assert (X : 1 / 2 * (Guard.v_max S * H) <= Rmax (norm z - clear) 0).
    { apply Rle_trans with (norm z - clear); [|apply Rmax_l].
      assert (v_own * H <= Guard.v_max S * H) by (apply Rmult_le_compat_r; lra). lra. }
    assert (Y : 2 * rate H * (1 / 2 * (Guard.v_max S * H)) <= 2 * rate H * Rmax (norm z - clear) 0)
      by (apply Rmult_le_compat_l; lra).
    replace (2 * rate H * (1 / 2 * (Guard.v_max S * H))) with (Guard.v_max S * (rate H * H)) in Y
      by field.
    rewrite HLH in Y. lra.
  - simpl in Hcase. fold H in Hcase.
    set (M := reach 0 v_own H (Guard.eps S)) in *.
    set (rho := slack r (Guard.eps S) clear (Guard.rounding S)) in *.
    set (b := wall_bound H rho M) in *.
    assert (HM0 : 0 <= v_own * H) by (apply Rmult_le_pos; lra).
    assert (HM : M = v_own * H + Guard.eps S) by (unfold M, reach; ring).
    assert (Hrho0 : 0 <= rho) by apply Rmax_r.
    assert (Hrn : norm (scale r n) = r) by (rewrite norm_scale, (unit_norm n Hn); lra).
    assert (Hrtrue : r <= norm z_true + Guard.eps S).
    { pose proof (norm_triangle (scale r n) z_true). lra. }
    exists b. split.
    + destruct Hcase as [Hskip|Hsides]; [apply Hslow; exact Hskip|].
      set (y := (speed c, across c)) in *.
      apply (cone_contains_the_truth n (rotate (middle theta_s H w_low w_high) y) z y b r M
               (middle theta_s H w_low w_high)
               (spread H w_low w_high (Guard.eta S)) theta_t lam);
        try assumption; try reflexivity; try lra.
      * unfold spread. assert (0 <= H * (w_high - w_low)) by (apply Rmult_le_pos; lra). lra.
      * unfold b, wall_bound. pose proof (bound_pos H rho M HH Hrho0). lra.
      * assert (T : norm (minus z (scale r n))
                    <= norm (minus z z_true) + norm (minus z_true (scale r n))).
        { replace (minus z (scale r n)) with (plus (minus z z_true) (minus z_true (scale r n)));
            [apply norm_plus|].
          unfold plus, minus. simpl. f_equal; ring. }
        rewrite (norm_minus_sym z_true) in T. lra.
      * unfold middle, spread. lra.
    + unfold b, wall_bound, bound. unfold Rmax at 1 3.
      destruct (Rle_dec (rho * exp (-2)) (rho - M)) as [Hsec|Hfst].
      * right. rewrite <- Rmult_assoc. apply Rmult_le_compat_l; [lra|].
        enough (Hnow : rho - M <= Rmax (norm z - clear) 0) by exact Hnow.
        unfold rho, slack, Rmax at 1. destruct (Rle_dec _ 0).
        -- apply Rle_trans with 0; [lra|apply Rmax_r].
        -- apply Rle_trans with (norm z - clear); [|apply Rmax_l]. lra.
      * left. rewrite <- Rmult_assoc. apply Rmult_le_compat_l; [lra|]. rewrite Rmult_comm.
        apply Rmult_le_compat_l; [left; apply exp_pos|].
        unfold rho, slack. apply Rle_max_compat_r. lra.
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

Lemma guarded_beside_is_guarded S nearest clear r :
  guarded_beside S nearest clear r -> guarded S (fun _ => False) r.
Proof.
  intros [A [B [C [D [E F]]]]]. repeat (split; [assumption|]). intros k.
  destruct (F k) as [F0 F1]. split; [exact F0|].
  destruct F1 as [Hs|[v [lo [hi [G1 [G2 [G3 [G4 _]]]]]]]]; [left; exact Hs|right].
  exists v, lo, hi. repeat (split; [assumption|]). intros o [].
Qed.

(** The setting of robots that stop at once, as a setting of robots that brake. *)
Definition at_once (S : Guard.setting) : braking_setting :=
  BrakingSetting (Guard.lifetime S) (rate (Guard.lifetime S)) (Guard.v_max S) (Guard.d S) (Guard.eps S)
    (Guard.eta S) (Guard.rounding S) 1.

Theorem share_of_the_slack_beside_a_wall (S : Guard.setting) (C : vec -> Prop) (nearest : vec -> vec)
    (clear : R) (r : robot) :
  Guard.sensible S -> guarded_beside S nearest clear r -> convex C -> nearest_of C nearest ->
  clear <= clearance nearest r 0 ->
  keeps_its_share_of (at_once S) r (an_obstacle (at_once S) nearest clear r).
Proof.
  intros HS Hr HC HP Hstart t g Ht Hdist Hg. simpl in *.
  pose proof HS as [HH [HV [Hd [Heps [Heta Hrnd]]]]].
  pose proof (rate_pos (Guard.lifetime S) HH) as HL.
  pose proof (rate_times_H (Guard.lifetime S) HH) as HLH.
  set (L := rate (Guard.lifetime S)) in *. set (k2 := 2 * L) in *.
  set (slack_at := its_slack (an_obstacle (at_once S) nearest clear r)) in *.
  assert (H0 : 0 <= slack_at 0) by (unfold slack_at, its_slack; simpl; unfold clearance in Hstart; lra).
  destruct (slack_so_far slack_at k2 t g H0 Ht Hg) as [Hg0 Hslack].
  set (z := minus (front r t) (nearest (front r t))) in *.
  assert (Hzero : 0 <= 2 * L * (exp (- k2 * t) * g)).
  { apply Rmult_le_pos; [lra|]. apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]. }
  assert (Henough : forall b, b <= 2 * L * (exp (- k2 * t) * g) ->
            - b <= dot (scale (/ norm z) z) (front_velocity r t) ->
            - (2 * L * exp (- k2 * t) * g) <= dot (scale (/ norm z) z) (front_velocity r t)).
  { intros b Hb Hdot. lra. }
  pose proof (guarded_beside_is_guarded S nearest clear r Hr) as Hguard.
  pose proof Hr as [Hmr [Hobeyr [Hchron [Hone [Hsent Hall]]]]].
  destruct (Hobeyr t Ht) as [_ [_ Hdoes]].
  assert (Hstill : v r t = 0 -> side r t = 0 ->
            - (2 * L * exp (- k2 * t) * g) <= dot (scale (/ norm z) z) (front_velocity r t)).
  { intros Hv Hw. apply (Henough 0); [lra|]. unfold front_velocity. rewrite Hv, Hw.
    unfold dot, rotate; simpl. lra. }
  destruct (in_force (Guard.lifetime S) (mail r) t) as [c|] eqn:Hc;
    [|destruct Hdoes as [? [? _]]; apply Hstill; assumption].
  destruct Hdoes as [lam [Hlam [Hv [Hw _]]]].
  destruct (acts_within_its_lifetime (Guard.lifetime S) (mail r) t c Hchron Hc) as [Hlife [m Hm]].
  destruct (Hsent m) as [k Hk]. rewrite Hk in Hm. subst c. clear m Hk.
  destruct (Hall k) as [Hs0 [Hstands | [v_own [lo [hi [Hown [Hlohi [Hcov [Halive Hresp]]]]]]]]].
  { destruct Hstands as [S1 [S2 _]]. rewrite S1, S2 in *. apply Hstill; lra. }
  set (c := computed r k) in *. set (s := stamp c) in *.
  assert (Hsince : forall tau, s <= tau < t ->
            norm (v r tau, side r tau) <= v_own /\ lo <= w r tau <= hi).
  { intros tau Htau.
    apply (wheels_since_the_sample S r (fun _ => False) k v_own lo hi t tau); try assumption; try lra.
    fold c. fold s. lra. }
  assert (Hown_moved : norm (minus (front r t) (front r s)) <= v_own * (t - s)).
  { apply front_moves_at_most; [exact Hmr|lra|lra|]. intros x Hx. apply (Hsince x Hx). }
  assert (Hturned : lo * (t - s) <= heading r t - heading r s <= hi * (t - s)).
  { apply heading_turns_within; [exact Hmr|lra|]. intros x Hx. apply (Hsince x Hx). }
  set (zs := minus (front r s) (nearest (front r s))) in *.
  assert (Hmoved : norm (minus z zs) <= v_own * Guard.lifetime S).
  { apply Rle_trans with (norm (minus (front r t) (front r s))).
    - apply (the_rest_is_not_longer C); assumption.
    - apply Rle_trans with (1 := Hown_moved). apply Rmult_le_compat_l; lra. }
  destruct (certificate_holds_beside_a_wall S clear v_own lo hi (heading r s) (heading r t) lam c
              zs z HS Hown Hlohi Hcov Hresp Hlam Hdist Hmoved) as [b [Hb Hterms]].
  { assert (lo * Guard.lifetime S <= lo * (t - s)) by (apply Rmult_le_compat_neg_l; lra).
    assert (hi * (t - s) <= hi * Guard.lifetime S) by (apply Rmult_le_compat_l; lra). lra. }
  fold L in Hterms.
  apply (Henough b).
  - destruct Hterms as [Hfirst|Hsecond].
    + eapply Rle_trans; [exact Hfirst|]. apply Rmult_le_compat_l; [lra|].
      pose proof (Hslack s ltac:(lra)) as B. unfold slack_at, its_slack in B. simpl in B. fold zs in B.
      apply Rle_trans with (exp (-2) * (exp (- k2 * s) * g)).
      * apply Rmult_le_compat_l; [left; apply exp_pos|exact B].
      * rewrite <- Rmult_assoc, <- exp_plus. apply Rmult_le_compat_r; [exact Hg0|].
        assert (Hexp : -2 + - k2 * s <= - k2 * t).
        { unfold k2. assert (X : L * (t - s) <= L * Guard.lifetime S) by (apply Rmult_le_compat_l; lra).
          rewrite HLH in X. lra. }
        destruct (Rle_lt_or_eq_dec _ _ Hexp) as [Hlt|Heq];
          [left; apply exp_increasing; exact Hlt|right; rewrite Heq; reflexivity].
    + eapply Rle_trans; [exact Hsecond|]. apply Rmult_le_compat_l; [lra|].
      pose proof (Hslack t ltac:(lra)) as B. unfold slack_at, its_slack in B. simpl in B. exact B.
  - unfold front_velocity. rewrite Hv, Hw.
    replace (lam * speed c, lam * across c) with (scale lam (speed c, across c)) by reflexivity.
    exact Hb.
Qed.

Theorem no_robot_that_stops_at_once_comes_nearer_to_an_obstacle (S : Guard.setting)
    (r : robot) (C : vec -> Prop) (nearest : vec -> vec) (clear : R) :
  Guard.sensible S -> guarded_beside S nearest clear r ->
  convex C -> nearest_of C nearest -> 0 < clear ->
  clear <= clearance nearest r 0 ->
  forall t, 0 <= t -> clear <= clearance nearest r t.
Proof.
  intros HS Hr HC HP Hclear Hstart t Ht. pose proof HS as [HH [HV _]].
  pose proof (rate_pos (Guard.lifetime S) HH) as HL.
  pose proof (share_of_the_slack_beside_a_wall S C nearest clear r HS Hr HC HP Hstart) as Hshare.
  pose proof Hr as [Hmr [Hobeyr _]].
  set (rho := fun x => clearance nearest r x - clear).
  assert (HE : E_of rho (2 * rate (Guard.lifetime S)) 0 <= E_of rho (2 * rate (Guard.lifetime S)) t).
  { apply (core_slack rho (2 * rate (Guard.lifetime S)) clear);
      [lra|exact Hclear|unfold rho; lra| | |lra].
    - apply (clearance_continuous (Guard.v_max S) C); try assumption.
      intros x Hx. apply (Hobeyr x Hx).
    - intros u g Hu Hg Hhigh.
      apply (clearance_falls_at_most (at_once S) C nearest clear); try assumption.
      unfold rho in Hhigh. lra. }
  unfold E_of in HE. rewrite Rmult_0_r, exp_0, Rmult_1_l in HE.
  pose proof (exp_pos (2 * rate (Guard.lifetime S) * t)) as P. unfold rho in HE.
  destruct (Rle_lt_dec clear (clearance nearest r t)) as [|Hlt]; [assumption|exfalso].
  assert (exp (2 * rate (Guard.lifetime S) * t) * (clearance nearest r t - clear) < 0) by nra. lra.
Qed.
