(** A robot that stops at once, next to any object: another robot or an obstacle, with the object's own speed, share and
    distance, and with any rate Lambda > 0. The formulas are those of Braking.v with the braking time 0.

    With Lambda = 1/H they are those of Guard.v and Walls.v: [respects_is_certified], [respects_wall_is_certified]. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Time Inertia Braking.
Open Scope R_scope.

(** The setting without Lambda. *)
Definition without_rate (S : braking_setting) : Guard.setting :=
  Guard.Setting (lifetime S) (v_max S) (d S) (eps S) (eta S) (rounding S).

(** The new command does not approach the object faster than b, for all directions in the cone; or b is not restrictive;
    or the object is too far away to be sensed. *)
Definition certified_at_once_against (S : braking_setting) (v_own w_low w_high theta : R) (c : command) (x : near)
    (s : R) : Prop :=
  far_braking (kept x) (share x) (Lambda S) (lifetime S) 0 (v_max S) (its_speed x) <= norm (apart x s) \/
  exists r n theta_sensed,
    0 <= r /\ dot n n = 1 /\ norm (minus (scale r n) (apart x s)) <= eps S /\
    - eta S <= theta_sensed - theta <= eta S /\
    let M := reach (its_speed x) v_own (lifetime S) (eps S) in
    let b := braking_bound (share x) (Lambda S) (lifetime S) 0 (slack r (eps S) (kept x) (rounding S)) M in
    let Psi := psi (spread (lifetime S) w_low w_high (eta S)) (swing M r) in
    v_own <= b \/
    forall a, - Psi <= a <= Psi ->
      - b <= dot (rotate a n) (rotate (middle theta_sensed (lifetime S) w_low w_high) (speed c, across c)).

(** Command k is zero, or certified against every object. The other unexpired commands only bound the speed and the turn
    rate. *)
Definition certified_at_once (S : braking_setting) (all : near -> Prop) (r : robot) (k : nat) : Prop :=
  let c := computed r k in
  Time.stands c \/
  exists v_own w_low w_high,
    0 <= v_own <= v_max S /\ w_low <= 0 <= w_high /\
    covers v_own w_low w_high c /\
    covers_the_alive (without_rate S) r k v_own w_low w_high /\
    forall x, all x -> certified_at_once_against S v_own w_low w_high (heading r (stamp c)) c x (stamp c).

(** Requirements on one robot. *)
Definition stops_at_once (S : braking_setting) (all : near -> Prop) (r : robot) : Prop :=
  moves r /\ obeys (lifetime S) (v_max S) r /\
  chronological (mail r) /\ one_living_incarnation (computed r) /\
  sent_by (computed r) (mail r) /\
  forall k, 0 <= stamp (computed r k) /\ certified_at_once S all r k.

Lemma sensible_without_rate S : sensible S -> Guard.sensible (without_rate S).
Proof. intros [HH [_ Hrest]]. split; assumption. Qed.

Lemma stops_at_once_is_guarded S all r :
  stops_at_once S all r -> guarded (without_rate S) (fun _ => False) r.
Proof.
  intros [A [B [C [D [E F]]]]]. repeat (split; [assumption|]). intros k.
  destruct (F k) as [F0 F1]. split; [exact F0|].
  destruct F1 as [Hs|[v [lo [hi [G1 [G2 [G3 [G4 _]]]]]]]]; [left; exact Hs|right].
  exists v, lo, hi. repeat (split; [assumption|]). intros o [].
Qed.

Lemma bound_without_braking share L H rho M :
  braking_bound share L H 0 rho M = share * Rmax (exp (-2 * L * H) * rho) (rho - M).
Proof.
  unfold braking_bound, mu. rewrite Rmult_0_r. destruct (Rle_dec 0 1); [ring|lra].
Qed.

(** For a fraction of [c], from a heading within the range. *)
Theorem certificate_holds_at_once (S : braking_setting) (v_own w_low w_high theta theta_t lam : R) (c : command)
    (x : near) (s t : R) :
  sensible S -> 0 <= v_own <= v_max S -> w_low <= 0 <= w_high -> 0 <= its_speed x -> 0 < share x ->
  covers v_own w_low w_high c ->
  certified_at_once_against S v_own w_low w_high theta c x s ->
  0 <= lam <= 1 -> 0 < norm (apart x t) ->
  norm (minus (apart x t) (apart x s)) <= (its_speed x + v_own) * lifetime S ->
  lifetime S * w_low <= theta_t - theta <= lifetime S * w_high ->
  exists b,
    - b <= dot (scale (/ norm (apart x t)) (apart x t)) (rotate theta_t (scale lam (speed c, across c))) /\
    b <= share x * Rmax (exp (-2 * Lambda S * lifetime S) * Rmax (its_slack x s) 0) (Rmax (its_slack x t) 0).
Proof.
  intros [HH [HL [HV [Hd [Heps [Heta Hrnd]]]]]] Hown Hw HVx Hshare [Hcs _] Hcert Hlam Hz Hmoved Hturned.
  unfold certified_at_once_against in Hcert. cbv zeta in Hcert.
  set (z := apart x t) in *. set (zs := apart x s) in *. set (H := lifetime S) in *. set (L := Lambda S) in *.
  set (y := (speed c, across c)) in *. set (n0 := scale (/ norm z) z).
  assert (Hfraction : forall b, 0 <= b -> - b <= dot n0 (rotate theta_t y) ->
            - b <= dot n0 (rotate theta_t (scale lam y))).
  { intros b Hb B. rewrite rotate_scale, dot_scale.
    assert (lam * - b <= lam * dot n0 (rotate theta_t y)) by (apply Rmult_le_compat_l; lra). nra. }
  assert (Hslow : forall b, v_own <= b -> - b <= dot n0 (rotate theta_t (scale lam y))).
  { intros b Hb. apply Hfraction; [lra|]. pose proof (dot_ge_norms n0 (rotate theta_t y)) as B.
    assert (E1 : norm n0 = 1).
    { unfold n0. rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hz). field. lra. }
    rewrite E1, rotate_norm in B. lra. }
  assert (HM0 : 0 <= (its_speed x + v_own) * H) by (apply Rmult_le_pos; lra).
  pose proof (norm_triangle zs z) as Hfar. rewrite norm_minus_sym in Hfar.
  (* what the bound is worth *)
  assert (Hworth : forall rho M, rho <= Rmax (its_slack x s) 0 -> rho - M <= Rmax (its_slack x t) 0 ->
            braking_bound (share x) L H 0 rho M
            <= share x * Rmax (exp (-2 * L * H) * Rmax (its_slack x s) 0) (Rmax (its_slack x t) 0)).
  { intros rho M B1 B2. rewrite bound_without_braking. apply Rmult_le_compat_l; [lra|].
    apply Rmax_lub; [eapply Rle_trans; [|apply Rmax_l]|eapply Rle_trans; [exact B2|apply Rmax_r]].
    apply Rmult_le_compat_l; [left; apply exp_pos|exact B1]. }
  assert (Hnow : forall M, (its_speed x + v_own) * H <= M ->
            Rmax (norm zs - kept x) 0 - M <= Rmax (its_slack x t) 0).
  { intros M HM. unfold Rmax at 1. destruct (Rle_dec _ 0).
    - eapply Rle_trans; [|apply Rmax_r]. lra.
    - eapply Rle_trans; [|apply Rmax_l]. unfold its_slack. fold z. lra. }
  destruct Hcert as [Hunsensed|[r [n [theta_s [Hr [Hn [Herr [Htheta Hcase]]]]]]]].
  - exists (braking_bound (share x) L H 0 (Rmax (norm zs - kept x) 0) ((v_own + its_speed x) * H)). split.
    + apply Hslow. apply (far_is_far_enough (kept x) (share x) L H 0 0 (v_max S)); try assumption; lra.
    + apply Hworth; [unfold its_slack; fold zs; lra|].
      apply Hnow. lra.
  - set (M := reach (its_speed x) v_own H (eps S)) in *.
    set (rho := slack r (eps S) (kept x) (rounding S)) in *.
    set (b := braking_bound (share x) L H 0 rho M) in *.
    assert (EM : M = (its_speed x + v_own) * H + eps S) by reflexivity.
    assert (Hrho0 : 0 <= rho) by apply Rmax_r.
    assert (Hrn : norm (scale r n) = r) by (rewrite norm_scale, (unit_norm n Hn); lra).
    assert (Hrtrue : r <= norm zs + eps S).
    { pose proof (norm_triangle (scale r n) zs). lra. }
    assert (Hb0 : 0 <= b).
    { unfold b. rewrite bound_without_braking. apply Rmult_le_pos; [lra|]. eapply Rle_trans; [|apply Rmax_l].
      apply Rmult_le_pos; [left; apply exp_pos|exact Hrho0]. }
    exists b. split.
    + destruct Hcase as [Hskip|Hcone]; [apply Hslow; exact Hskip|].
      apply Hfraction; [exact Hb0|].
      destruct (truth_is_in_the_cone n z r M (middle theta_s H w_low w_high) (spread H w_low w_high (eta S)) theta_t
                  Hn) as [a [Ha Ea]]; try assumption.
      * lra.
      * unfold spread. assert (0 <= H * (w_high - w_low)) by (apply Rmult_le_pos; lra). lra.
      * assert (T : norm (minus z (scale r n)) <= norm (minus z zs) + norm (minus zs (scale r n))).
        { replace (minus z (scale r n)) with (plus (minus z zs) (minus zs (scale r n))); [apply norm_plus|].
          unfold plus, minus. simpl. f_equal; ring. }
        rewrite (norm_minus_sym zs) in T. lra.
      * unfold middle, spread. lra.
      * unfold n0. rewrite Ea. apply Hcone. exact Ha.
    + assert (Hle : rho <= Rmax (norm zs - kept x) 0) by (unfold rho, slack; apply Rle_max_compat_r; lra).
      apply Hworth; [exact Hle|].
      pose proof (Hnow M ltac:(lra)) as B. lra.
Qed.

(** At every instant at most the share is used up. *)
Theorem share_of_the_slack_at_once (S : braking_setting) (r : robot) (all : near -> Prop) (p : near) :
  sensible S -> stops_at_once S all r -> all p -> moves_beside r p -> 0 <= its_slack p 0 ->
  keeps_its_share_of S r p.
Proof.
  intros HS Hr Hp [HVp [Hshare Hbeside]] Hstart t g Ht Hdist Hg.
  pose proof HS as [HH [HL [HV [Hd [Heps [Heta Hrnd]]]]]].
  set (L := Lambda S) in *. set (k2 := 2 * L) in *.
  destruct (slack_so_far (its_slack p) k2 t g Hstart Ht Hg) as [Hg0 Hslack].
  set (n0 := scale (/ norm (apart p t)) (apart p t)).
  assert (Hzero : 0 <= share p * (exp (- k2 * t) * g)).
  { apply Rmult_le_pos; [lra|]. apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]. }
  assert (Henough : forall b, b <= share p * (exp (- k2 * t) * g) -> - b <= dot n0 (front_velocity r t) ->
            - (share p * exp (- k2 * t) * g) <= dot n0 (front_velocity r t)).
  { intros b Hb Hdot. lra. }
  pose proof (stops_at_once_is_guarded S all r Hr) as Hguard.
  pose proof Hr as [Hmr [Hobeyr [Hchron [Hone [Hsent Hall]]]]].
  destruct (Hobeyr t Ht) as [_ [_ Hdoes]].
  assert (Hstill : v r t = 0 -> side r t = 0 ->
            - (share p * exp (- k2 * t) * g) <= dot n0 (front_velocity r t)).
  { intros Hv Hw. apply (Henough 0); [lra|]. unfold front_velocity. rewrite Hv, Hw.
    unfold dot, rotate; simpl. lra. }
  destruct (in_force (lifetime S) (mail r) t) as [c|] eqn:Hc; [|destruct Hdoes as [? [? _]]; apply Hstill; assumption].
  destruct Hdoes as [lam [Hlam [Hv [Hw _]]]].
  destruct (acts_within_its_lifetime (lifetime S) (mail r) t c Hchron Hc) as [Hlife [m Hm]].
  destruct (Hsent m) as [k Hk]. rewrite Hk in Hm. subst c. clear m Hk.
  destruct (Hall k) as [Hs0 [Hstands | [v_own [lo [hi [Hown [Hlohi [Hcov [Halive Hcert]]]]]]]]].
  { destruct Hstands as [S1 [S2 _]]. rewrite S1, S2 in *. apply Hstill; lra. }
  set (c := computed r k) in *. set (s := stamp c) in *.
  assert (Hsince : forall tau, s <= tau < t -> norm (v r tau, side r tau) <= v_own /\ lo <= w r tau <= hi).
  { intros tau Htau.
    apply (wheels_since_the_sample (without_rate S) r (fun _ => False) k v_own lo hi t tau); try assumption; try lra.
    - apply sensible_without_rate. exact HS.
    - fold c. fold s. lra. }
  assert (Hown_moved : norm (minus (front r t) (front r s)) <= v_own * (t - s)).
  { apply front_moves_at_most; [exact Hmr|lra|lra|]. intros x Hx. apply (Hsince x Hx). }
  assert (Hturned : lo * (t - s) <= heading r t - heading r s <= hi * (t - s)).
  { apply heading_turns_within; [exact Hmr|lra|]. intros x Hx. apply (Hsince x Hx). }
  assert (Hmoved : norm (minus (apart p t) (apart p s)) <= (its_speed p + v_own) * lifetime S).
  { pose proof (Hbeside s t ltac:(lra)) as B.
    assert ((its_speed p + v_own) * (t - s) <= (its_speed p + v_own) * lifetime S)
      by (apply Rmult_le_compat_l; lra). lra. }
  destruct (certificate_holds_at_once S v_own lo hi (heading r s) (heading r t) lam c p s t
              HS Hown Hlohi HVp Hshare Hcov (Hcert p Hp) Hlam Hdist Hmoved) as [b [Hb Hworth]].
  { assert (lo * lifetime S <= lo * (t - s)) by (apply Rmult_le_compat_neg_l; lra).
    assert (hi * (t - s) <= hi * lifetime S) by (apply Rmult_le_compat_l; lra). lra. }
  apply (Henough b).
  - eapply Rle_trans; [exact Hworth|]. fold L. apply Rmult_le_compat_l; [lra|].
    apply Rmax_lub; [|apply Hslack; lra].
    (* e^(-2 Lambda H) of the slack at the sample, at most H ago *)
    apply Rle_trans with (exp (-2 * L * lifetime S) * (exp (- k2 * s) * g)).
    + apply Rmult_le_compat_l; [left; apply exp_pos|apply Hslack; lra].
    + rewrite <- Rmult_assoc, <- exp_plus. apply Rmult_le_compat_r; [exact Hg0|].
      assert (Hexp : -2 * L * lifetime S + - k2 * s <= - k2 * t).
      { unfold k2. assert (X : L * (t - s) <= L * lifetime S) by (apply Rmult_le_compat_l; lra). lra. }
      destruct (Rle_lt_or_eq_dec _ _ Hexp) as [Hlt|Heq];
        [left; apply exp_increasing; exact Hlt|right; rewrite Heq; reflexivity].
  - unfold front_velocity. rewrite Hv, Hw.
    replace (lam * speed c, lam * across c) with (scale lam (speed c, across c)) by reflexivity.
    exact Hb.
Qed.

(** ** The same with Lambda = 1/H: the formulas of Guard.v. *)

(** The setting of robots that stop at once, as a setting of robots that brake. *)
Definition at_once (S : Guard.setting) : braking_setting :=
  BrakingSetting (Guard.lifetime S) (rate (Guard.lifetime S)) (Guard.v_max S) (Guard.d S) (Guard.eps S)
    (Guard.eta S) (Guard.rounding S) 1.

Lemma sensible_at_once S : Guard.sensible S -> sensible (at_once S).
Proof.
  intros [HH Hrest]. split; [exact HH|]. split; [apply rate_pos; exact HH|exact Hrest].
Qed.

Lemma without_rate_at_once S : without_rate (at_once S) = S.
Proof. destruct S. reflexivity. Qed.

(** [q] is 1 against a robot, 2 against an obstacle. *)
Lemma bound_at_once q H rho M : 0 < H -> braking_bound (q * rate H) (rate H) H 0 rho M = q * bound H rho M.
Proof.
  intros HH. rewrite bound_without_braking. unfold bound.
  replace (-2 * rate H * H) with (-2 * (rate H * H)) by ring. rewrite (rate_times_H H HH).
  rewrite Rmult_1_r, (Rmult_comm rho). ring.
Qed.

Lemma far_at_once q keep H v_max V :
  0 < H -> 0 < q -> far_braking keep (q * rate H) (rate H) H 0 v_max V <= keep + (v_max / q + v_max + V) * H.
Proof.
  intros HH Hq. unfold far_braking. apply Rplus_le_compat_l. eapply Rle_trans; [apply Rmin_r|].
  unfold mu. rewrite Rmult_0_r. destruct (Rle_dec 0 1); [|lra]. right. unfold rate. field. split; lra.
Qed.

Lemma half_planes_bound_the_cone n U b spr M r :
  0 <= b -> 0 <= spr -> 0 <= M -> let Psi := psi spr (swing M r) in
  cone_sides n U b Psi (Guard.count Psi) -> forall a, - Psi <= a <= Psi -> - b <= dot (rotate a n) U.
Proof.
  intros Hb Hspr HM Psi Hsides a Ha. pose proof (psi_bounds spr M r Hspr HM) as HP. fold Psi in HP.
  destruct (count_fits _ HP) as [HK Hstep].
  apply (sides_bound_the_cone n U b Psi (Guard.count Psi)); try assumption. apply HP.
Qed.

Lemma respects_is_certified (S : Guard.setting) (v_own w_low w_high theta : R) (c : command) (r o : robot) (s : R) :
  Guard.sensible S -> 0 <= v_own -> w_low <= 0 <= w_high ->
  respects S v_own w_low w_high theta c (minus (front r s) (front o s)) ->
  certified_at_once_against (at_once S) v_own w_low w_high theta c (another_robot (at_once S) r o) s.
Proof.
  intros [HH [HV [Hd [Heps [Heta Hrnd]]]]] Hown Hw Hresp.
  destruct Hresp as [Hfar|[q [n [theta_s [Hq [Hn [Herr [Htheta Hcase]]]]]]]]; [left|right].
  - simpl. eapply Rle_trans; [|exact Hfar].
    pose proof (far_at_once 1 (Guard.d S) (Guard.lifetime S) (Guard.v_max S) (Guard.v_max S) HH ltac:(lra)) as B.
    rewrite Rmult_1_l in B. unfold far. lra.
  - exists q, n, theta_s. repeat (split; [assumption|]). cbv zeta in *. simpl.
    set (M := reach (Guard.v_max S) v_own (Guard.lifetime S) (Guard.eps S)) in *.
    set (gap := slack q (Guard.eps S) (Guard.d S) (Guard.rounding S)) in *.
    pose proof (bound_at_once 1 (Guard.lifetime S) gap M HH) as B. rewrite !Rmult_1_l in B. rewrite B.
    destruct Hcase as [Hskip|Hsides]; [left; exact Hskip|right].
    apply half_planes_bound_the_cone; [| | |exact Hsides].
    + apply bound_pos; [exact HH|apply Rmax_r].
    + unfold spread. assert (0 <= Guard.lifetime S * (w_high - w_low)) by (apply Rmult_le_pos; lra). lra.
    + unfold M, reach. assert (0 <= (Guard.v_max S + v_own) * Guard.lifetime S) by (apply Rmult_le_pos; lra). lra.
Qed.

(** Robots that are certified as in Time.v. *)
Theorem guarded_stops_at_once (S : Guard.setting) (others : robot -> Prop) (r : robot) :
  Guard.sensible S -> guarded S others r ->
  stops_at_once (at_once S) (fun x => exists o, others o /\ x = another_robot (at_once S) r o) r.
Proof.
  intros HS [A [B [C [D [E F]]]]]. repeat (split; [assumption|]). intros k.
  destruct (F k) as [F0 F1]. split; [exact F0|].
  destruct F1 as [Hs|[v [lo [hi [G1 [G2 [G3 [G4 G5]]]]]]]]; [left; exact Hs|right].
  exists v, lo, hi. rewrite without_rate_at_once. repeat (split; [assumption|]). intros x [o [Ho ->]].
  apply respects_is_certified; try assumption; [apply G1|apply G5; exact Ho].
Qed.

(** At every instant, for every robot and for any losses, delays, stops and restarts: the robot uses up at most its half
    of the slack,

        n(t) . alpha'(t) >= - Lambda e^(-2 Lambda t) g(t),

    where g is the running maximum of E = e^(2 Lambda t) rho, and rho the distance minus d. *)
Theorem share_of_the_slack (S : Guard.setting) (r o : robot) (others : robot -> Prop) (t g : R) :
  Guard.sensible S -> guarded S others r -> others o ->
  (* of the other robot only that it moves and keeps the speed limit *)
  moves o -> obeys (Guard.lifetime S) (Guard.v_max S) o ->
  0 <= rho (Guard.d S) r o 0 -> 0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho (Guard.d S) r o) (2 * rate (Guard.lifetime S))) t g ->
  - (rate (Guard.lifetime S) * exp (- (2 * rate (Guard.lifetime S)) * t) * g)
  <= dot (direction r o t) (front_velocity r t).
Proof.
  intros HS Hr Ho Hmo Hobeyo Hstart. pose proof (sensible_at_once S HS) as HS'.
  apply (share_of_the_slack_at_once (at_once S) r _ (another_robot (at_once S) r o) HS'
           (guarded_stops_at_once S others r HS Hr)); [exists o; auto| |exact Hstart].
  apply another_robot_moves_beside; [exact HS'|exact Hmo|]. intros x Hx. apply (Hobeyo x Hx).
Qed.
