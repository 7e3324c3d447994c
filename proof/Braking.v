(** The guard (safety filter) with braking: the certificate, and the guarantee for robots with inertia.

    An object in range may be another robot or a fixed obstacle. The argument needs only its maximum speed, the
    share of the slack that the robot may use up, and the distance to be kept.

    The definitions from [braking_rate] to [far_braking] are the guard's formulas. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Inertia.
Open Scope R_scope.

(** Constants of the scenario, common to all robots: the command timeout, s; the rate Lambda, 1/s; the speed
    limit, m/s; the minimum distance, m; bounds on the errors of a sensed vector, m, and of the heading, rad;
    the margin that the guard subtracts from every distance, m. Any Lambda > 0 is permitted. *)
Record braking_setting := BrakingSetting {
  lifetime : R;        (* H *)
  Lambda : R;
  v_max : R;
  d : R;
  eps : R;
  eta : R;
  rounding : R;
  turn_part : R        (* part of the braking time that counts for the turn of the heading: 1/2 or 1 *)
}.

Definition sensible (S : braking_setting) : Prop :=
  0 < lifetime S /\ 0 < Lambda S /\ 0 <= v_max S /\ 0 < d S /\ 0 <= eps S /\ 0 <= eta S /\
  0 <= rounding S.

(* Lambda, with the maximum braking time of all robots *)
Definition braking_rate (H tau : R) : R := 1 / (H + tau).
(* M: maximum displacement of both until the robot is at rest; [V] is the other's speed *)
Definition swept (v_own V H tau_o eps : R) : R :=
  v_own * (H + 1 / 2 * tau_o) + V * (H + tau_o) + eps.
(* b: [share] is Lambda against a robot, 2 Lambda against an obstacle; [reach] is the displacement within one
    command timeout *)
Definition braking_bound (share Lambda H tau_o rho reach : R) : R :=
  share * mu (2 * Lambda * tau_o) * Rmax (exp (-2 * Lambda * H) * rho) (rho - reach).
(* time for which the heading turns at the full rate; part is 1/2 if w decreases with the speed of a front point *)
Definition turning_time (part H tau_o : R) : R := H + part * tau_o.
(* distance from which on an object need not be sensed *)
Definition far_braking (keep share Lambda H tau v_max V : R) : R :=
  keep + Rmin (v_max / (share * mu (2 * Lambda * tau)) * exp (2 * Lambda * H))
              (v_max / (share * mu (2 * Lambda * tau)) + (v_max + V) * H).

(** An object in range of a robot: the vector from it to the robot's front point, m; its maximum own speed, m/s;
    the share of the slack that the robot may use up, 1/s; the distance to be kept, m. *)
Record near := Near {
  apart : R -> vec;
  its_speed : R;
  share : R;
  kept : R
}.

Definition its_slack (x : near) (t : R) : R := norm (apart x t) - kept x.

Definition another_robot (S : braking_setting) (r o : robot) : near :=
  Near (fun t => minus (front r t) (front o t)) (v_max S) (Lambda S) (d S).

(** The vector to the object changes by the motion of the robot and by the motion of the object. *)
Definition moves_beside (r : robot) (x : near) : Prop :=
  0 <= its_speed x /\ 0 < share x /\
  forall s t, 0 <= s <= t ->
    norm (minus (apart x t) (apart x s))
    <= norm (minus (front r t) (front r s)) + its_speed x * (t - s).

(** At every instant the robot uses up at most its share of the slack. *)
Definition keeps_its_share_of (S : braking_setting) (r : robot) (x : near) : Prop :=
  forall t g, 0 <= t -> 0 < norm (apart x t) ->
  running_max (E_of (its_slack x) (2 * Lambda S)) t g ->
  - (share x * exp (- (2 * Lambda S) * t) * g)
  <= dot (scale (/ norm (apart x t)) (apart x t)) (front_velocity r t).

(** ** The certificate. *)

(** None of the twists in [K] approaches the object faster than b, for all of its directions and all own
    headings possible until the robot is at rest; or b is not restrictive; or the object is too far away to be
    sensed. *)
Definition certified_against (S : braking_setting) (tau v_own tau_o w_low w_high theta : R)
    (K : vec -> Prop) (x : near) (s : R) : Prop :=
  far_braking (kept x) (share x) (Lambda S) (lifetime S) tau (v_max S) (its_speed x)
    <= norm (apart x s) \/
  exists r n theta_sensed,
    0 <= r /\ dot n n = 1 /\ norm (minus (scale r n) (apart x s)) <= eps S /\
    - eta S <= theta_sensed - theta <= eta S /\
    let h := turning_time (turn_part S) (lifetime S) tau_o in
    let M := swept v_own (its_speed x) (lifetime S) tau_o (eps S) in
    let b := braking_bound (share x) (Lambda S) (lifetime S) tau_o
               (slack r (eps S) (kept x) (rounding S))
               (reach (its_speed x) v_own (lifetime S) (eps S)) in
    let Psi := psi (spread h w_low w_high (eta S)) (swing M r) in
    v_own <= b \/
    forall y a, K y -> - Psi <= a <= Psi ->
      - b <= dot (rotate a n) (rotate (middle theta_sensed h w_low w_high) y).

(** Test of a twist Y (rotated to the middle heading) against the whole cone at once. *)
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

(** 0, the twist at the sample, the unexpired commands, and command k itself. *)
Definition on_the_way (S : braking_setting) (r : robot) (k : nat) (y : vec) : Prop :=
  let s := stamp (computed r k) in
  y = zero \/ y = state r s \/ y = twist_of r (computed r k) \/
  (exists l, (l < k)%nat /\ s < stamp (computed r l) + lifetime S /\ y = twist_of r (computed r l)).

(** The certificate of command k, for the twists in [K]. *)
Definition certificate (S : braking_setting) (N : vec -> R) (tau : R) (r : robot) (all : near -> Prop) (k : nat)
    (K : vec -> Prop) : Prop :=
  exists v_own tau_o w_low w_high,
    0 <= v_own <= v_max S /\ 0 < tau_o <= tau /\ w_low <= 0 <= w_high /\
    (forall y, K y -> fits N v_own tau_o y) /\
    (w_low <= w r (stamp (computed r k)) <= w_high /\ w_low <= turn (computed r k) <= w_high /\
     forall l, (l < k)%nat -> stamp (computed r k) < stamp (computed r l) + lifetime S ->
       w_low <= turn (computed r l) <= w_high) /\
    forall x, all x ->
      certified_against S tau v_own tau_o w_low w_high (heading r (stamp (computed r k)))
        K x (stamp (computed r k)).

(** Command k is zero, or the certificate covers 0, the twist at the sample, the unexpired commands, and the
    command itself. *)
Definition certified (S : braking_setting) (N : vec -> R) (tau : R) (r : robot) (all : near -> Prop) (k : nat)
  : Prop :=
  stands (computed r k) \/ certificate S N tau r all k (on_the_way S r k).

(** Command k is zero, or the certificate covers the four corners of a rectangle that contains these twists, for
    instance of the smallest one. *)
Definition certified_by_corners (S : braking_setting) (N : vec -> R) (tau : R) (r : robot) (all : near -> Prop)
    (k : nat) : Prop :=
  stands (computed r k) \/
  exists low high, (forall y, on_the_way S r k y -> in_rectangle low high y) /\
    certificate S N tau r all k (corner low high).

(** While a robot brakes, its turn rate may be anything between its value and 0; or it decreases in proportion to the
    speed across of a front point, and then turns the heading half as far. *)
Definition turns_while_braking (S : braking_setting) (r : robot) : Prop :=
  turn_part S = 1 \/
  turn_part S = 1 / 2 /\ exists ell, 0 < ell /\ forall t, side r t = ell * w r t.

(** The twist moves on segments, and the certificates are about their ends; or its components change independently,
    and the certificates are about the corners of rectangles. *)
Definition approaches_as_certified (S : braking_setting) (N : vec -> R) (tau : R) (all : near -> Prop) (r : robot)
  : Prop :=
  approaches (lifetime S) N r /\ (forall k, certified S N tau r all k) \/
  approaches_on_each_axis (lifetime S) N r /\ (forall k, certified_by_corners S N tau r all k).

(** Requirements on one robot. P1 is the plant's rule for commands, as without inertia. *)
Definition brakes (S : braking_setting) (N : vec -> R) (tau : R) (all : near -> Prop) (r : robot) : Prop :=
  moves r /\ (approaches_as_certified S N tau all r /\ turns_between (lifetime S) r /\ turns_while_braking S r) /\
  state r 0 = zero /\
  never_faster_than (v_max S) r /\
  chronological (mail r) /\ one_living_incarnation (computed r) /\
  sent_by (computed r) (mail r) /\
  forall k, 0 <= stamp (computed r k).

(** ** The twists since the sample are certified. *)

(** If the four corners of a rectangle are within the bounds, all its twists are; and if the corners do not approach an
    object faster than b, for all of its directions, none of its twists does. *)
Theorem four_corners_suffice (N : vec -> R) (low high n : vec) (v_own tau_o b Psi mid : R) :
  gauge N ->
  ((forall y, corner low high y -> fits N v_own tau_o y) ->
   forall y, in_rectangle low high y -> fits N v_own tau_o y) /\
  ((forall y a, corner low high y -> - Psi <= a <= Psi -> - b <= dot (rotate a n) (rotate mid y)) ->
   forall y a, in_rectangle low high y -> - Psi <= a <= Psi -> - b <= dot (rotate a n) (rotate mid y)).
Proof.
  intros [Gpos [_ Ghull]]. split.
  - intros HK y Hy.
    assert (Hh : within_hull (corner low high) y).
    { intros L b' _ Hb. apply (corners_bound_the_rectangle low high); assumption. }
    assert (Hlow : corner low high low) by (split; left; reflexivity).
    destruct (HK low Hlow) as [Nv Nt]. pose proof (norm_pos low). pose proof (Gpos low). split.
    + apply (norm_within_hull (corner low high)); [lra| |exact Hh]. intros k Hk. apply (HK k Hk).
    + apply (Ghull (corner low high)); [lra| |exact Hh]. intros k Hk. apply (HK k Hk).
  - intros HK y a Hy Ha. rewrite dot_comm, dot_rotate, dot_comm.
    apply (corners_bound_the_rectangle low high); [|exact Hy]. intros k Hk.
    rewrite dot_comm, <- dot_rotate, dot_comm. apply HK; assumption.
Qed.

Lemma certificate_of_the_rectangle S N tau r all k low high :
  gauge N -> certificate S N tau r all k (corner low high) ->
  certificate S N tau r all k (in_rectangle low high).
Proof.
  intros HG [v_own [tau_o [lo [hi [Hown [Htau [Hlh [HK [HW Hnear]]]]]]]]].
  exists v_own, tau_o, lo, hi. repeat (split; [assumption|]). split; [|split; [exact HW|]].
  - apply (four_corners_suffice N low high zero v_own tau_o 0 0 0 HG). exact HK.
  - intros x Hx. destruct (Hnear x Hx) as [Hfar|[r' [n [theta [Hr [Hn [Hsensed [Htheta Hkeeps]]]]]]]];
      [left; exact Hfar|right].
    exists r', n, theta. repeat (split; [assumption|]). cbv zeta in *.
    destruct Hkeeps as [Hskip|Hcone]; [left; exact Hskip|right].
    apply (four_corners_suffice N low high n v_own tau_o); [exact HG|exact Hcone].
Qed.

Lemma gauge_of S N tau all r : approaches_as_certified S N tau all r -> gauge N.
Proof. intros [[[HG _] _]|[[HG _] _]]; exact HG. Qed.

Lemma rests_until_it_moves S N tau all r t :
  approaches_as_certified S N tau all r -> state r 0 = zero -> 0 <= t ->
  (forall x, 0 <= x < t -> target (lifetime S) r x = zero) -> state r t = zero.
Proof.
  intros Happ Hrest Ht Hzero. destruct Happ as [[[_ [_ [_ [_ Hray]]]] _]|[[_ [_ Hray]] _]].
  - destruct (Hray 0 t ltac:(lra) Hzero) as [lam [_ [E _]]]. rewrite E, Hrest. apply scale_zero.
  - destruct (Hray 0 t ltac:(lra) Hzero) as [l1 [l2 [_ [_ [E _]]]]]. rewrite E.
    unfold state, zero in Hrest. injection Hrest as -> ->. unfold zero. f_equal; ring.
Qed.

(** All twists since the sample of command k are in the hull of certified ones. From its expiry on, the twist is a
    fraction of one in the hull whose speed across is a fraction of that at the expiry. *)
Theorem twists_since_the_sample (S : braking_setting) (N : vec -> R) (tau : R) (all : near -> Prop) (r : robot)
    (k : nat) (t : R) :
  approaches_as_certified S N tau all r -> 0 < lifetime S ->
  0 <= stamp (computed r k) -> ~ stands (computed r k) ->
  let s := stamp (computed r k) in
  let t1 := s + lifetime S in
  (forall x, s <= x <= t -> on_the_way S r k (target (lifetime S) r x)) ->
  (forall x, t1 <= x <= t -> target (lifetime S) r x = zero) ->
  exists K, certificate S N tau r all k K /\
    (forall x, s <= x <= t -> within_hull K (state r x)) /\
    (forall x tau_o, t1 <= x <= t -> 0 < tau_o -> N (state r t1) <= tau_o ->
       exists lam y part, 0 <= lam <= Rmax 0 (1 - (x - t1) / tau_o) /\ within_hull K y /\
         0 <= part <= 1 /\ snd y = part * side r t1 /\ state r x = scale lam y).
Proof.
  intros Happ HH Hs0 Hmov s t1 Htarget Hlater. subst t1.
  assert (Hin0 : on_the_way S r k zero) by (left; reflexivity).
  assert (Hins : on_the_way S r k (state r s)) by (right; left; reflexivity).
  destruct Happ as [[Happ Hall]|[Happ Hall]].
  - destruct (Hall k) as [Hstands|Hcert]; [contradiction|].
    assert (Hinv : forall x, s <= x <= t -> within_hull (on_the_way S r k) (state r x)).
    { intros x Hx M b Hb HM.
      apply (stays_in_half_plane (lifetime S) N r M b s x Happ); [unfold s in *; lra|exact Hb| |].
      - apply HM. exact Hins.
      - intros x' Hx'. apply HM. apply Htarget. lra. }
    exists (on_the_way S r k). split; [exact Hcert|]. split; [exact Hinv|].
    intros x tau_o Hx Htau HN.
    destruct (shrinks_on_its_ray (lifetime S) N r (s + lifetime S) x tau_o) as [lam [Hlam E]];
      try assumption; [unfold s in *; lra|intros x' Hx'; apply Hlater; lra|].
    exists lam, (state r (s + lifetime S)), 1. split; [exact Hlam|]. split; [apply Hinv; lra|].
    split; [lra|]. split; [simpl; ring|exact E].
  - destruct (Hall k) as [Hstands|[low [high [Hin Hcert]]]]; [contradiction|].
    pose proof Happ as [HG [Hstay _]].
    assert (Hinv : forall x, s <= x <= t -> in_rectangle low high (state r x)).
    { intros x Hx. apply (Hstay s x); [unfold s in *; lra|apply Hin; exact Hin0|apply Hin; exact Hins|].
      intros x' Hx'. apply Hin. apply Htarget. lra. }
    assert (Hhull : forall y, in_rectangle low high y -> within_hull (in_rectangle low high) y).
    { intros y Hy M b _ HM. apply HM. exact Hy. }
    exists (in_rectangle low high).
    split; [apply certificate_of_the_rectangle; assumption|].
    split; [intros x Hx; apply Hhull; apply Hinv; exact Hx|].
    intros x tau_o Hx Htau HN.
    destruct (shrinks_on_each_axis (lifetime S) N r (s + lifetime S) x tau_o) as [lam [m1 [m2 [Hlam [M1 [M2 E]]]]]];
      try assumption; [unfold s in *; lra|intros x' Hx'; apply Hlater; lra|].
    exists lam, (m1 * v r (s + lifetime S), m2 * side r (s + lifetime S)), m2.
    split; [exact Hlam|]. split; [|split; [exact M2|]; split; [reflexivity|exact E]].
    apply Hhull. destruct (Hin _ Hin0) as [Z1 Z2]. destruct (Hinv (s + lifetime S) ltac:(lra)) as [Y1 Y2].
    unfold in_rectangle, state, zero in *. simpl in *. split; split; nra.
Qed.

(** ** Objects that are not sensed are too far away to matter. *)

Lemma far_is_far_enough keep share L H tau tau_o v_max V v_own r :
  0 < share -> 0 < L -> 0 < H -> 0 <= tau_o <= tau -> 0 <= v_own <= v_max -> 0 <= V ->
  far_braking keep share L H tau v_max V <= r ->
  v_own <= braking_bound share L H tau_o (Rmax (r - keep) 0) ((v_own + V) * H).
Proof.
  intros Hshare HL HH Htau Hv HV Hfar.
  pose proof (mu_range (2 * L * tau)) as Hmu.
  assert (Hless : mu (2 * L * tau) <= mu (2 * L * tau_o)).
  { apply mu_falls. split; [apply Rmult_le_pos; lra|]. apply Rmult_le_compat_l; lra. }
  unfold far_braking in Hfar. unfold braking_bound.
  set (q := share * mu (2 * L * tau)) in *.
  assert (Hq : 0 < q) by (apply Rmult_lt_0_compat; lra).
  set (q' := share * mu (2 * L * tau_o)).
  assert (Hqq : q <= q') by (apply Rmult_le_compat_l; lra).
  set (z := v_max / q) in *.
  assert (Ez : v_max = q * z) by (unfold z; field; lra).
  assert (Hz : 0 <= z) by (unfold z; apply Rdiv_le_0_compat; lra).
  assert (Hle : q * z <= q' * Rmax (exp (-2 * L * H) * Rmax (r - keep) 0)
                                 (Rmax (r - keep) 0 - (v_own + V) * H)).
  { apply Rmult_le_compat; [lra|exact Hz|exact Hqq|].
    pose proof (Rmax_l (r - keep) 0) as B.
    unfold Rmin in Hfar. destruct (Rle_dec (z * exp (2 * L * H)) (z + (v_max + V) * H)).
    - eapply Rle_trans; [|apply Rmax_l].
      apply Rle_trans with (exp (-2 * L * H) * (z * exp (2 * L * H))).
      + right. rewrite Rmult_comm, Rmult_assoc, <- exp_plus.
        replace (2 * L * H + -2 * L * H) with 0 by ring. rewrite exp_0. ring.
      + apply Rmult_le_compat_l; [left; apply exp_pos|lra].
    - eapply Rle_trans; [|apply Rmax_r].
      assert ((v_own + V) * H <= (v_max + V) * H) by (apply Rmult_le_compat_r; lra). lra. }
  lra.
Qed.

(** ** At every instant at most the share is used up. *)

Lemma turns_at_most_in_part (lo hi q lam part x : R) :
  0 <= lam <= q -> 0 <= part <= 1 -> lo <= 0 <= hi -> lo <= x <= hi -> lo * q <= lam * part * x <= hi * q.
Proof.
  intros Hl Hp H0 Hx.
  assert (Hq : 0 <= lam * part <= q).
  { split; [apply Rmult_le_pos; lra|]. assert (lam * part <= lam * 1) by (apply Rmult_le_compat_l; lra). lra. }
  set (z := lam * part) in *. split.
  - apply Rle_trans with (lo * z); [apply Rmult_le_compat_neg_l; lra|].
    rewrite (Rmult_comm lo). apply Rmult_le_compat_l; lra.
  - apply Rle_trans with (z * hi); [apply Rmult_le_compat_l; lra|].
    rewrite (Rmult_comm z). apply Rmult_le_compat_l; lra.
Qed.

Theorem share_of_the_slack_with_inertia (S : braking_setting) (N : vec -> R) (tau : R) (r : robot)
    (all : near -> Prop) (p : near) :
  sensible S -> brakes S N tau all r -> all p -> moves_beside r p -> 0 <= its_slack p 0 ->
  keeps_its_share_of S r p.
Proof.
  intros [HH [HL [HV [Hd [Heps [Heta Hround]]]]]]
    [Mr [[Happ [Hturns Hbody]] [Hrest [Vr [Hchron [Hone [Hsent Hall]]]]]]] Hp [HVp [Hshare Hbeside]] Hstart.
  intros t g Ht Hdist Hg.
  set (L := Lambda S) in *. set (k2 := 2 * L) in *.
  destruct (slack_so_far (its_slack p) k2 t g Hstart Ht Hg) as [Hg0 Hslack].
  set (n := scale (/ norm (apart p t)) (apart p t)).
  change (front_velocity r t) with (rotate (heading r t) (state r t)).
  assert (Hzero : 0 <= share p * (exp (- k2 * t) * g)).
  { apply Rmult_le_pos; [lra|]. apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]. }
  assert (Henough : forall b, b <= share p * (exp (- k2 * t) * g) ->
            - b <= dot n (rotate (heading r t) (state r t)) ->
            - (share p * exp (- k2 * t) * g) <= dot n (rotate (heading r t) (state r t))).
  { intros b Hb Hdot. lra. }
  assert (Hstill : state r t = zero ->
            - (share p * exp (- k2 * t) * g) <= dot n (rotate (heading r t) (state r t))).
  { intros E. apply (Henough 0); [lra|]. rewrite E. unfold rotate, zero, dot; simpl. lra. }
  destruct (what_acts_since_the_last_sample (lifetime S) r t Hchron Hone Hsent HH)
    as [Hnone|[k [Hmov [Hst [Hmay Hlater]]]]].
  { (* no command has moved it yet *)
    apply Hstill. apply (rests_until_it_moves S N tau all r t Happ Hrest Ht).
    intros x Hx. apply target_of_none_that_moves. intros c Hc. apply (Hnone x c); [lra|exact Hc]. }
  pose proof (Hall k) as Hs0.
  set (c := computed r k) in *. set (s := stamp c) in *.
  pose proof Mr as [Hell [Ch [_ [_ Hdr]]]].
  pose proof (gauge_of S N tau all r Happ) as HG.
  (* targets and twists since the sample *)
  set (t1 := s + lifetime S) in *.
  assert (Et1 : t1 = s + lifetime S) by reflexivity.
  destruct (twists_since_the_sample S N tau all r k t Happ HH Hs0 Hmov)
    as [K [[v_own [tau_o [lo [hi [Hown [[Htau Htau'] [Hlh [HK [HW Hnear]]]]]]]]] [Hinv Hbrake]]].
  { intros x Hx. unfold target.
    destruct (in_force (lifetime S) (mail r) x) as [c'|] eqn:E; [|left; reflexivity].
    destruct (Hmay x c' Hx E) as [[S1 [S2 _]]|[->|[l [Hlk [-> Hal]]]]].
    - left. unfold twist_of, zero. rewrite S1, S2. reflexivity.
    - right. right. left. reflexivity.
    - right. right. right. exists l. auto. }
  { intros x Hx. apply target_of_none_that_moves. intros c' Hc'. apply (Hlater x c'); [exact Hx|exact Hc']. }
  fold c in HW, Hnear, Hinv, Hbrake. fold s in HW, Hnear, Hinv, Hbrake. fold t1 in Hbrake.
  assert (Hfit : forall y, within_hull K y -> fits N v_own tau_o y).
  { intros y Hy. apply (fits_on_the_way N v_own tau_o K); try assumption; lra. }
  assert (Hfits : forall x, s <= x <= t -> fits N v_own tau_o (state r x)).
  { intros x Hx. apply Hfit. apply Hinv. exact Hx. }
  assert (Hw : forall x, s <= x <= t -> lo <= w r x <= hi).
  { intros x Hx. destruct HW as [W1 [W2 W3]].
    apply (Hturns s x lo hi); [lra|exact Hlh|exact W1|].
    intros x' c' Hx' E. destruct (Hmay x' c' ltac:(lra) E) as [[_ [_ S3]]|[->|[l [Hlk [-> Hal]]]]].
    - rewrite S3. exact Hlh.
    - exact W2.
    - apply (W3 l Hlk). exact Hal. }
  assert (Hshrink : forall x, t1 <= x <= t ->
            exists lam y part, 0 <= lam <= Rmax 0 (1 - (x - t1) / tau_o) /\ within_hull K y /\
              0 <= part <= 1 /\ snd y = part * side r t1 /\ state r x = scale lam y).
  { intros x Hx. apply Hbrake; [exact Hx|exact Htau|]. apply (Hfits t1). lra. }
  (* permanently at rest *)
  destruct (Rle_lt_dec t (t1 + tau_o)) as [Hsoon|Hlate].
  2: { destruct (Hshrink t ltac:(lra)) as [lam [y [_ [Hlam [_ [_ [_ E]]]]]]].
       assert (1 < (t - t1) / tau_o).
       { apply Rmult_lt_reg_r with tau_o; [exact Htau|]. unfold Rdiv.
         rewrite Rmult_assoc, Rinv_l; lra. }
       rewrite Rmax_left in Hlam by lra. apply Hstill. rewrite E.
       replace lam with 0 by lra. unfold scale, zero. f_equal; ring. }
  set (h := lifetime S + tau_o / 2).
  assert (Eh : h = lifetime S + tau_o / 2) by reflexivity.
  set (ht := turning_time (turn_part S) (lifetime S) tau_o).
  assert (Eht : ht = lifetime S + turn_part S * tau_o) by reflexivity.
  assert (Hpart : 1 / 2 <= turn_part S <= 1) by (destruct Hbody as [E|[E _]]; rewrite E; lra).
  assert (Hht : lifetime S <= ht) by (rewrite Eht; nra).
  set (z := apart p t) in *.
  set (zs := apart p s).
  assert (Hown_early : forall x, s <= x <= t -> x <= t1 ->
            norm (minus (front r x) (front r s)) <= v_own * (x - s)).
  { intros x Hx Hx1. apply front_moves_at_most; [exact Mr|lra|lra|].
    intros x' Hx'. apply (Hfits x'). lra. }
  assert (Hown_moved : norm (minus (front r t) (front r s)) <= v_own * h).
  { destruct (Rle_lt_dec t t1) as [Hearly|Hbraking].
    - pose proof (Hown_early t ltac:(lra) Hearly) as B. rewrite Eh.
      assert (v_own * (t - s) <= v_own * (lifetime S + tau_o / 2))
        by (apply Rmult_le_compat_l; lra). lra.
    - pose proof (Hown_early t1 ltac:(lra) ltac:(lra)) as B.
      assert (C : norm (minus (front r t) (front r t1)) <= v_own * tau_o / 2).
      { apply front_moves_while_braking; [exact Mr|lra|exact Htau|lra|].
        intros x Hx. destruct (Hshrink x ltac:(lra)) as [lam [y [_ [Hlam [Hy [_ [_ E]]]]]]].
        rewrite E, norm_scale by lra. destruct (Hfit y Hy) as [Ny _].
        pose proof (norm_pos y). rewrite Rmult_comm.
        apply Rmult_le_compat; lra. }
      assert (T : norm (minus (front r t) (front r s))
                  <= norm (minus (front r t) (front r t1)) + norm (minus (front r t1) (front r s))).
      { replace (minus (front r t) (front r s))
          with (plus (minus (front r t) (front r t1)) (minus (front r t1) (front r s)));
          [apply norm_plus|].
        unfold plus, minus. simpl. f_equal; ring. }
      rewrite Eh. unfold t1 in B at 2. lra. }
  assert (Hrel : forall x A B, s <= x <= t ->
            norm (minus (front r x) (front r s)) <= A -> its_speed p * (x - s) <= B ->
            norm (minus (apart p x) zs) <= A + B).
  { intros x A B Hx HA HB. pose proof (Hbeside s x ltac:(lra)) as T. fold zs in T. lra. }
  assert (Hmoved : norm (minus z zs) <= v_own * h + its_speed p * (lifetime S + tau_o)).
  { apply (Hrel t); [lra|exact Hown_moved|]. apply Rmult_le_compat_l; lra. }
  assert (Hturned : ht * lo <= heading r t - heading r s <= ht * hi).
  { destruct Hbody as [Epart|[Epart [ell [Hell' Hside]]]].
    { assert (B : lo * (t - s) <= heading r t - heading r s <= hi * (t - s)).
      { apply heading_turns_within; [exact Mr|lra|]. intros x Hx. apply Hw. lra. }
      assert (t - s <= ht) by (rewrite Eht, Epart; lra).
      assert (lo * ht <= lo * (t - s)) by (apply Rmult_le_compat_neg_l; lra).
      assert (hi * (t - s) <= hi * ht) by (apply Rmult_le_compat_l; lra). lra. }
    assert (Hearly : forall x, s <= x <= t -> x <= t1 ->
              lo * (x - s) <= heading r x - heading r s <= hi * (x - s)).
    { intros x Hx Hx1. apply heading_turns_within; [exact Mr|lra|].
      intros x' Hx'. apply Hw. lra. }
    destruct (Rle_lt_dec t t1) as [Ht1|Hbraking].
    - pose proof (Hearly t ltac:(lra) Ht1) as B.
      assert (lo * ht <= lo * (t - s)) by (apply Rmult_le_compat_neg_l; lra).
      assert (hi * (t - s) <= hi * ht) by (apply Rmult_le_compat_l; lra). lra.
    - pose proof (Hearly t1 ltac:(lra) ltac:(lra)) as B.
      assert (Hlam : forall x, t1 <= x < t ->
                lo * Rmax 0 (1 - (x - t1) / tau_o) <= w r x <= hi * Rmax 0 (1 - (x - t1) / tau_o)).
      { intros x Hx. destruct (Hshrink x ltac:(lra)) as [lam [y [part [Hl [_ [Hpart' [Ey E]]]]]]].
        assert (Ew : w r x = lam * part * w r t1).
        { unfold state, scale in E. simpl in E. injection E as _ E. rewrite Ey, (Hside x), (Hside t1) in E.
          apply Rmult_eq_reg_l with ell; lra. }
        rewrite Ew. apply turns_at_most_in_part; [exact Hl|exact Hpart'|exact Hlh|]. apply Hw. lra. }
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
      replace (t1 - s) with (lifetime S) in B by (unfold t1; ring). rewrite Eht, Epart. lra. }
  (* value of the slack at the sample, at the end of the command timeout or now *)
  set (rho := its_slack p s) in *. assert (Erho : rho = norm zs - kept p) by reflexivity.
  set (worth := Rmax (exp (-2 * L * lifetime S) * Rmax rho 0)
                     (rho - (v_own + its_speed p) * lifetime S)).
  assert (Hworth : forall x, s <= x <= t -> x <= t1 -> worth <= exp (- k2 * x) * g).
  { intros x Hx Hx1. apply Rmax_lub.
    - pose proof (Hslack s ltac:(lra)) as B. fold rho in B.
      apply Rle_trans with (exp (-2 * L * lifetime S) * (exp (- k2 * s) * g)).
      + apply Rmult_le_compat_l; [left; apply exp_pos|exact B].
      + rewrite <- Rmult_assoc, <- exp_plus. apply Rmult_le_compat_r; [exact Hg0|].
        assert (Hexp : -2 * L * lifetime S + - k2 * s <= - k2 * x).
        { assert (X : L * (x - s) <= L * lifetime S)
            by (apply Rmult_le_compat_l; lra).
          unfold k2. lra. }
        destruct (Rle_lt_or_eq_dec _ _ Hexp) as [Hlt|Heq];
          [left; apply exp_increasing; exact Hlt|right; rewrite Heq; reflexivity].
    - apply Rle_trans with (Rmax (its_slack p x) 0); [|apply Hslack; lra].
      eapply Rle_trans; [|apply Rmax_l].
      assert (v_own * (x - s) <= v_own * lifetime S)
        by (apply Rmult_le_compat_l; lra).
      assert (its_speed p * (x - s) <= its_speed p * lifetime S)
        by (apply Rmult_le_compat_l; lra).
      pose proof (Hown_early x Hx Hx1) as B.
      pose proof (Hrel x (v_own * lifetime S) (its_speed p * lifetime S) Hx ltac:(lra) ltac:(lra)) as C.
      pose proof (norm_triangle zs (apart p x)) as T.
      rewrite (norm_minus_sym zs) in T. unfold its_slack. lra. }
  pose proof (mu_range (2 * L * tau_o)) as Hmu.
  assert (Hunit : norm n = 1).
  { unfold n. rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hdist). field. lra. }
  (* the certificate, for the current direction and heading *)
  assert (Hcert : exists beta, 0 <= beta <= worth /\
            forall y, K y ->
              - (share p * mu (2 * L * tau_o) * beta) <= dot n (rotate (heading r t) y)).
  { assert (Hslow : forall b, v_own <= b -> forall y, K y -> - b <= dot n (rotate (heading r t) y)).
    { intros b Hb y Hy. destruct (HK y Hy) as [Ny _].
      pose proof (dot_ge_norms n (rotate (heading r t) y)) as B.
      rewrite Hunit, rotate_norm in B. lra. }
    destruct (Hnear p Hp) as [Hfar|[r' [m [theta [Hr [Hm [Hsensed [Htheta Hkeeps]]]]]]]].
    - exists worth. split.
      + split; [|lra]. eapply Rle_trans; [|apply Rmax_l].
        apply Rmult_le_pos; [left; apply exp_pos|apply Rmax_r].
      + apply Hslow. fold zs in Hfar.
        pose proof (far_is_far_enough (kept p) (share p) L (lifetime S) tau tau_o (v_max S)
                      (its_speed p) v_own (norm zs) Hshare HL HH ltac:(lra) Hown HVp Hfar) as B.
        unfold braking_bound in B. fold L in B. rewrite <- Erho in B.
        eapply Rle_trans; [exact B|]. apply Rmult_le_compat_l; [apply Rmult_le_pos; lra|].
        unfold worth. apply Rmax_lub; [apply Rmax_l|].
        unfold Rmax at 1. destruct (Rle_dec rho 0) as [Hneg|Hpos]; [|apply Rmax_r].
        eapply Rle_trans; [|apply Rmax_l].
        apply Rle_trans with 0.
        * assert (0 <= (v_own + its_speed p) * lifetime S) by (apply Rmult_le_pos; lra). lra.
        * apply Rmult_le_pos; [left; apply exp_pos|apply Rmax_r].
    - cbv zeta in Hkeeps. fold ht in Hkeeps. fold L in Hkeeps. fold zs in Hsensed.
      set (M := swept v_own (its_speed p) (lifetime S) tau_o (eps S)) in *.
      assert (EM : M = v_own * h + its_speed p * (lifetime S + tau_o) + eps S).
      { unfold M, swept. rewrite Eh. field. }
      set (q := slack r' (eps S) (kept p) (rounding S)) in *.
      set (beta := Rmax (exp (-2 * L * lifetime S) * q)
                        (q - reach (its_speed p) v_own (lifetime S) (eps S))).
      assert (Hq : 0 <= q <= Rmax rho 0).
      { unfold q, slack. split; [apply Rmax_r|]. apply Rle_max_compat_r.
        pose proof (norm_triangle (scale r' m) zs) as T.
        rewrite norm_scale, (unit_norm m Hm) in T by exact Hr. lra. }
      assert (Hbeta : 0 <= beta <= worth).
      { unfold beta, worth. split.
        - eapply Rle_trans; [|apply Rmax_l]. apply Rmult_le_pos; [left; apply exp_pos|lra].
        - assert (Hfirst : exp (-2 * L * lifetime S) * q <= exp (-2 * L * lifetime S) * Rmax rho 0)
            by (apply Rmult_le_compat_l; [left; apply exp_pos|lra]).
          apply Rmax_lub; [eapply Rle_trans; [exact Hfirst|apply Rmax_l]|].
          unfold reach. assert (0 <= (its_speed p + v_own) * lifetime S) by (apply Rmult_le_pos; lra).
          destruct (Rle_lt_dec rho 0) as [Hneg|Hpos].
          + rewrite (Rmax_right rho 0) in * by exact Hneg.
            eapply Rle_trans; [|apply Rmax_l]. lra.
          + rewrite (Rmax_left rho 0) in * by lra. eapply Rle_trans; [|apply Rmax_r]. lra. }
      exists beta. split; [exact Hbeta|].
      assert (Eb : braking_bound (share p) L (lifetime S) tau_o q
                     (reach (its_speed p) v_own (lifetime S) (eps S))
                   = share p * mu (2 * L * tau_o) * beta) by reflexivity.
      rewrite Eb in Hkeeps. clear Eb.
      destruct Hkeeps as [Hskip|Hcone]; [apply Hslow; exact Hskip|].
      intros y Hy.
      assert (HM : 0 <= M).
      { rewrite EM. assert (0 <= v_own * h) by (apply Rmult_le_pos; lra).
        assert (0 <= its_speed p * (lifetime S + tau_o)) by (apply Rmult_le_pos; lra). lra. }
      assert (Hspr : 0 <= spread ht lo hi (eta S)).
      { unfold spread. assert (0 <= ht * (hi - lo)) by (apply Rmult_le_pos; lra). lra. }
      destruct (truth_is_in_the_cone m z r' M (middle theta ht lo hi)
                  (spread ht lo hi (eta S)) (heading r t) Hm HM Hspr Hdist) as [x [Hx Ex]].
      + pose proof (norm_plus (minus z zs) (minus zs (scale r' m))) as T.
        replace (plus (minus z zs) (minus zs (scale r' m))) with (minus z (scale r' m)) in T
          by (unfold plus, minus; simpl; f_equal; ring).
        rewrite (norm_minus_sym zs) in T. lra.
      + unfold middle, spread. lra.
      + unfold n. rewrite Ex. apply Hcone; [exact Hy|exact Hx]. }
  destruct Hcert as [beta [[Hbeta0 Hbeta] Hcert]].
  set (b := share p * mu (2 * L * tau_o) * beta) in *.
  assert (Hb0 : 0 <= b) by (apply Rmult_le_pos; [apply Rmult_le_pos; lra|exact Hbeta0]).
  assert (Hfun : forall y0, within_hull K y0 -> - b <= dot n (rotate (heading r t) y0)).
  { intros y0 Hy0. rewrite dot_comm, dot_rotate, dot_comm.
    apply Hy0; [exact Hb0|].
    intros y Hy. rewrite dot_comm. rewrite <- (dot_rotate (heading r t) y n), dot_comm.
    apply Hcert. exact Hy. }
  destruct (Rle_lt_dec t t1) as [Hearly|Hbraking].
  - apply (Henough b); [|apply Hfun; apply Hinv; lra].
    pose proof (Hworth t ltac:(lra) Hearly) as B. unfold b.
    assert (mu (2 * L * tau_o) * beta <= 1 * beta) by (apply Rmult_le_compat_r; lra).
    rewrite Rmult_assoc. apply Rmult_le_compat_l; lra.
  - destruct (Hshrink t ltac:(lra)) as [lam [y [_ [Hlam [Hy [_ [_ E]]]]]]].
    pose proof (Hfun y Hy) as B.
    set (q := Rmax 0 (1 - (t - t1) / tau_o)) in *.
    apply (Henough (q * b)).
    + pose proof (Hworth t1 ltac:(lra) ltac:(lra)) as W.
      pose proof (braking_keeps_up k2 tau_o (t - t1) ltac:(unfold k2; lra) Htau ltac:(lra)) as U.
      fold q in U. unfold b.
      replace (q * (share p * mu (2 * L * tau_o) * beta))
        with (share p * (q * mu (k2 * tau_o) * beta)) by (unfold k2; ring).
      apply Rmult_le_compat_l; [lra|].
      apply Rle_trans with (exp (- k2 * (t - t1)) * (exp (- k2 * t1) * g)).
      * apply Rmult_le_compat; [|exact Hbeta0|exact U|lra].
        apply Rmult_le_pos; [apply Rmax_l|unfold k2; lra].
      * right. rewrite <- Rmult_assoc, <- exp_plus. f_equal. f_equal. ring.
    + rewrite E, rotate_scale, dot_scale.
      assert (lam * - b <= lam * dot n (rotate (heading r t) y))
        by (apply Rmult_le_compat_l; lra).
      assert (lam * b <= q * b) by (apply Rmult_le_compat_r; lra). lra.
Qed.

(** ** The guarantee, with inertia. *)

Lemma another_robot_moves_beside (S : braking_setting) (r o : robot) :
  sensible S -> moves o -> never_faster_than (v_max S) o -> moves_beside r (another_robot S r o).
Proof.
  intros [HH [HL [HV _]]] Mo Vo. split; [exact HV|]. split; [exact HL|].
  intros s t Hst. simpl.
  assert (HO : norm (minus (front o t) (front o s)) <= v_max S * (t - s)).
  { apply front_moves_at_most; [exact Mo|exact HV|exact Hst|]. intros x Hx. apply Vo. lra. }
  assert (T : norm (minus (minus (front r t) (front o t)) (minus (front r s) (front o s)))
              <= norm (minus (front r t) (front r s)) + norm (minus (front o s) (front o t))).
  { replace (minus (minus (front r t) (front o t)) (minus (front r s) (front o s)))
      with (plus (minus (front r t) (front r s)) (minus (front o s) (front o t)));
      [apply norm_plus|].
    unfold plus, minus. simpl. f_equal; ring. }
  rewrite (norm_minus_sym (front o s)) in T. lra.
Qed.

Theorem no_two_braking_robots_are_ever_nearer_than_d (I : Type) (S : braking_setting)
    (N : I -> vec -> R) (tau : I -> R) (all : I -> near -> Prop) (robots : I -> robot) :
  sensible S ->
  (forall i, brakes S (N i) (tau i) (all i) (robots i)) ->
  (forall i j, i <> j -> all i (another_robot S (robots i) (robots j))) ->
  (forall i j, i <> j -> d S <= distance (robots i) (robots j) 0) ->
  forall i j t, i <> j -> 0 <= t -> d S <= distance (robots i) (robots j) t.
Proof.
  intros HS G Hall Hstart i j t Hij Ht. pose proof HS as [HH [HL [HV [Hd _]]]].
  assert (Hshare : forall p q, p <> q -> keeps_its_share (Lambda S) (d S) (robots p) (robots q)).
  { intros p q Hpq.
    apply (share_of_the_slack_with_inertia S (N p) (tau p) _ (all p) (another_robot S (robots p) (robots q)) HS (G p)).
    - apply Hall. exact Hpq.
    - apply another_robot_moves_beside; [exact HS|apply (G q)|apply (G q)].
    - pose proof (Hstart p q Hpq) as B. unfold its_slack, another_robot. simpl.
      unfold distance in B. lra. }
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
