(** Directions: what a robot knows at its sample bounds what is true while its command acts.

    - If z moved by at most M < r since the sample, its direction turned by at most asin(M/r).
    - Half-planes at steps st with the bound b cos(st/2) imply the bound b for every direction
      between them.
    - The nearest point of a set that contains 0 and all that is between, is not longer than the
      point itself.
    - The front point of a held twist (v, w) moves at hypot(v, ell w), never faster. *)

Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors.
Open Scope R_scope.

(** ** Every direction is a turn of n, and near ones are small turns. *)

Lemma direction_is_a_turn (n z : vec) :
  dot n n = 1 -> 0 < norm z ->
  exists a, - PI <= a <= PI /\ z = scale (norm z) (rotate a n) /\
            Rabs a = acos (dot n z / norm z).
Proof.
  intros Hn Hz.
  set (p := dot n z). set (q := fst n * snd z - snd n * fst z).
  pose proof (norm_sq z) as Hsq.
  assert (Hpq : p * p + q * q = norm z * norm z).
  { rewrite Hsq. unfold p, q. destruct n as [n1 n2], z as [z1 z2]. unfold dot in *; simpl in *.
    transitivity ((n1 * n1 + n2 * n2) * (z1 * z1 + z2 * z2)); [ring|rewrite Hn; ring]. }
  set (c := p / norm z).
  assert (Hcc : p = c * norm z) by (unfold c; field; lra).
  assert (Hc : -1 <= c <= 1).
  { assert (c * c * (norm z * norm z) <= 1 * (norm z * norm z)) by (rewrite Hcc in Hpq; nra).
    assert (c * c <= 1) by (apply Rmult_le_reg_r with (norm z * norm z); nra). nra. }
  assert (Hs : sqrt (1 - c²) = Rabs q / norm z).
  { replace (1 - c²) with ((Rabs q / norm z) * (Rabs q / norm z)).
    - apply sqrt_square. apply Rdiv_le_0_compat; [apply Rabs_pos|exact Hz].
    - assert (Rabs q * Rabs q = q * q) by (rewrite <- Rabs_mult; apply Rabs_pos_eq; nra).
      unfold Rsqr. apply Rmult_eq_reg_r with (norm z * norm z); [|nra].
      transitivity (Rabs q * Rabs q); [field; lra|]. rewrite H. rewrite Hcc in Hpq. nra. }
  pose proof (acos_bound c) as Hb.
  assert (Hrot : forall a, cos a = c -> sin a = q / norm z -> z = scale (norm z) (rotate a n)).
  { intros a Hca Hsa. unfold scale, rotate. rewrite Hca, Hsa. unfold c, p, q.
    destruct n as [n1 n2], z as [z1 z2]. unfold dot in *; simpl in *.
    set (N := norm (z1, z2)) in *. f_equal.
    - transitivity ((n1 * n1 + n2 * n2) * z1); [rewrite Hn; ring|field; lra].
    - transitivity ((n1 * n1 + n2 * n2) * z2); [rewrite Hn; ring|field; lra]. }
  destruct (Rle_lt_dec 0 q) as [Hq|Hq].
  - exists (acos c). split; [lra|]. split.
    + apply Hrot; [apply cos_acos; exact Hc|].
      rewrite sin_acos by exact Hc. rewrite Hs, Rabs_pos_eq by exact Hq. reflexivity.
    + apply Rabs_pos_eq. lra.
  - exists (- acos c). split; [lra|]. split.
    + apply Hrot; [rewrite cos_neg; apply cos_acos; exact Hc|].
      rewrite sin_neg, sin_acos by exact Hc. rewrite Hs, Rabs_left by exact Hq. field. lra.
    + rewrite Rabs_Ropp. apply Rabs_pos_eq. lra.
Qed.

Theorem direction_within_asin (n z : vec) (r M : R) :
  dot n n = 1 -> 0 <= M < r -> norm (minus z (scale r n)) <= M ->
  0 < norm z /\
  exists a, - asin (M / r) <= a <= asin (M / r) /\ z = scale (norm z) (rotate a n).
Proof.
  intros Hn HM Hmoved.
  assert (Hz : 0 < norm z).
  { pose proof (norm_triangle (scale r n) z) as T.
    rewrite norm_minus_sym, norm_scale, (unit_norm n Hn) in T by lra. lra. }
  split; [exact Hz|].
  destruct (direction_is_a_turn n z Hn Hz) as [a [_ [Hrot Ha]]].
  exists a. split; [|exact Hrot].
  assert (Hle : Rabs a <= asin (M / r)); [|apply Rabs_le_between; exact Hle].
  rewrite Ha.
  set (p := dot n z) in *. set (q := fst n * snd z - snd n * fst z).
  assert (Hpq : p * p + q * q = norm z * norm z).
  { rewrite norm_sq. unfold p, q. destruct n as [n1 n2], z as [z1 z2]. unfold dot in *; simpl in *.
    transitivity ((n1 * n1 + n2 * n2) * (z1 * z1 + z2 * z2)); [ring|rewrite Hn; ring]. }
  assert (Hfar : (p - r) * (p - r) + q * q <= M * M).
  { pose proof (norm_pos (minus z (scale r n))). pose proof (norm_sq (minus z (scale r n))) as S.
    replace ((p - r) * (p - r) + q * q) with (dot (minus z (scale r n)) (minus z (scale r n))).
    - rewrite <- S. nra.
    - unfold p, q. destruct n as [n1 n2], z as [z1 z2]. unfold dot, minus, scale in *; simpl in *.
      transitivity ((z1 * z1 + z2 * z2) * (n1 * n1 + n2 * n2)
                    - 2 * r * (n1 * z1 + n2 * z2) + r * r * (n1 * n1 + n2 * n2));
        [rewrite Hn at 1; ring|rewrite Hn at 2; ring]. }
  assert (Hp : 0 < p) by nra.
  (* |q| r / |z| is the distance of r n from the line along z: at most M. *)
  assert (Hline : q * q * (r * r) <= M * M * (norm z * norm z)).
  { rewrite <- Hpq.
    assert (q * q * (r * r) <= ((p - r) * (p - r) + q * q) * (p * p + q * q)).
    { pose proof (Rle_0_sqr (p * p + q * q - p * r)) as S. unfold Rsqr in S. nra. }
    assert (((p - r) * (p - r) + q * q) * (p * p + q * q) <= M * M * (p * p + q * q))
      by (apply Rmult_le_compat_r; nra).
    lra. }
  set (x := M / r). assert (Hx : 0 <= x < 1).
  { unfold x. split; [apply Rdiv_le_0_compat; lra|].
    apply Rmult_lt_reg_r with r; [lra|]. unfold Rdiv. rewrite Rmult_assoc, Rinv_l by lra. lra. }
  set (c := p / norm z).
  assert (Hpc : p = c * norm z) by (unfold c; field; lra).
  assert (HMx : M = x * r) by (unfold x; field; lra).
  assert (Hc0 : 0 < c) by (apply Rdiv_lt_0_compat; lra).
  assert (Hcx : 1 - x * x <= c * c).
  { assert (Hr2 : 0 < r * r) by nra. assert (Hz2 : 0 < norm z * norm z) by nra.
    rewrite HMx in Hline.
    assert (q * q <= x * x * (norm z * norm z)).
    { apply Rmult_le_reg_r with (r * r); [exact Hr2|]. nra. }
    rewrite Hpc in Hpq. apply Rmult_le_reg_r with (norm z * norm z); [exact Hz2|]. nra. }
  assert (Hc1 : c <= 1).
  { assert (c * c * (norm z * norm z) <= 1 * (norm z * norm z)) by (rewrite Hpc in Hpq; nra).
    assert (c * c <= 1) by (apply Rmult_le_reg_r with (norm z * norm z); nra). nra. }
  destruct (Rle_lt_dec (acos c) (asin x)) as [|Hgt]; [assumption|exfalso].
  pose proof (acos_bound c) as B1. pose proof (asin_bound x) as B2. pose proof PI_RGT_0.
  assert (Hpos : 0 <= asin x).
  { destruct (Rle_lt_dec 0 (asin x)) as [|Hneg]; [assumption|exfalso].
    assert (Hsin : sin (asin x) < 0) by (apply sin_lt_0_var; lra).
    rewrite sin_asin in Hsin by lra. lra. }
  assert (Hcos : cos (acos c) < cos (asin x)) by (apply cos_decreasing_1; lra).
  rewrite cos_acos in Hcos by lra. rewrite cos_asin in Hcos by lra.
  assert (c * c < 1 - x * x).
  { assert (S : sqrt (1 - x²) * sqrt (1 - x²) = 1 - x²) by (apply sqrt_sqrt; unfold Rsqr; nra).
    unfold Rsqr in *. nra. }
  lra.
Qed.

(** ** Between two half-planes. *)

Lemma bound_between_two_sides (n u : vec) (b st x0 x : R) :
  0 <= b -> 0 < st < PI -> x0 <= x <= x0 + st ->
  - (b * cos (st / 2)) <= dot (rotate x0 n) u ->
  - (b * cos (st / 2)) <= dot (rotate (x0 + st) n) u ->
  - b <= dot (rotate x n) u.
Proof.
  intros Hb Hst Hx H0 H1.
  set (al := x - x0). set (be := x0 + st - x).
  assert (Hmix : sin st * dot (rotate x n) u
                 = sin be * dot (rotate x0 n) u + sin al * dot (rotate (x0 + st) n) u).
  { replace st with (al + be) at 1 by (unfold al, be; ring).
    replace x0 with (x - al) at 1 by (unfold al; ring).
    replace (x0 + st) with (x + be) by (unfold be; ring).
    destruct n as [n1 n2], u as [u1 u2]. unfold dot, rotate; simpl.
    rewrite cos_minus, sin_minus, cos_plus, !sin_plus. ring. }
  assert (Hsum : sin be + sin al = 2 * sin (st / 2) * cos ((be - al) / 2)).
  { rewrite form3. replace ((be + al) / 2) with (st / 2) by (unfold al, be; field).
    ring. }
  assert (Hdouble : sin st = 2 * sin (st / 2) * cos (st / 2)).
  { rewrite <- sin_2a. f_equal. field. }
  assert (Hal : 0 <= sin al) by (apply sin_ge_0; unfold al; lra).
  assert (Hbe : 0 <= sin be) by (apply sin_ge_0; unfold be; lra).
  assert (Hs : 0 < sin st) by (apply sin_gt_0; lra).
  assert (Hh : 0 < sin (st / 2)) by (apply sin_gt_0; lra).
  assert (Hhc : 0 < cos (st / 2)) by (apply cos_gt_0; lra).
  pose proof (COS_bound ((be - al) / 2)) as [_ Hcos].
  set (B := b * cos (st / 2)) in *.
  assert (HB : 0 <= B) by (apply Rmult_le_pos; lra).
  assert (E1 : sin be * - B <= sin be * dot (rotate x0 n) u) by (apply Rmult_le_compat_l; lra).
  assert (E2 : sin al * - B <= sin al * dot (rotate (x0 + st) n) u)
    by (apply Rmult_le_compat_l; lra).
  assert (E3 : B * (sin be + sin al) <= b * sin st).
  { rewrite Hsum, Hdouble. unfold B.
    replace (b * (2 * sin (st / 2) * cos (st / 2)))
      with (b * cos (st / 2) * (2 * sin (st / 2) * 1)) by ring.
    apply Rmult_le_compat_l; [exact HB|]. apply Rmult_le_compat_l; lra. }
  apply Rmult_le_reg_l with (sin st); [exact Hs|]. lra.
Qed.

(** Which two sides: the cone is cut into K' steps. *)
Lemma step_of (st x0 x : R) (K' : nat) :
  0 < st -> (0 < K')%nat -> x0 <= x <= x0 + INR K' * st ->
  exists q, (q < K')%nat /\ x0 + INR q * st <= x <= x0 + INR q * st + st.
Proof.
  intros Hst. induction K' as [|K IH]; [lia|]. intros _ Hx.
  rewrite S_INR in Hx.
  destruct (Rle_lt_dec x (x0 + INR K * st)) as [H|H].
  - destruct K as [|K].
    + exists 0%nat. simpl in *. split; [lia|lra].
    + destruct (IH ltac:(lia) ltac:(lra)) as [q [Hq Hqx]]. exists q. split; [lia|exact Hqx].
  - exists K. split; [lia|lra].
Qed.

(** The half-planes of a cone of half-angle psi around n, K of them. *)
Definition cone_step (psi : R) (K : nat) : R := 2 * psi / (INR K - 1).
Definition side_angle (psi : R) (K q : nat) : R := - psi + INR q * cone_step psi K.
Definition side_bound (b psi : R) (K : nat) : R := b * cos (cone_step psi K / 2).
Definition cone_sides (n u : vec) (b psi : R) (K : nat) : Prop :=
  forall q, (q < K)%nat -> - side_bound b psi K <= dot (rotate (side_angle psi K q) n) u.

Theorem sides_bound_the_cone (n u : vec) (b psi : R) (K : nat) (x : R) :
  0 <= b -> (2 <= K)%nat -> 0 <= psi -> cone_step psi K < PI ->
  cone_sides n u b psi K -> - psi <= x <= psi -> - b <= dot (rotate x n) u.
Proof.
  unfold cone_sides, side_angle, side_bound. intros Hb HK Hpsi Hst Hsides Hx.
  assert (HKR : 2 <= INR K) by (replace 2 with (INR 2) by reflexivity; apply le_INR; exact HK).
  assert (Hfull : (INR K - 1) * cone_step psi K = 2 * psi) by (unfold cone_step; field; lra).
  destruct (Rle_lt_or_eq_dec 0 psi Hpsi) as [Hpos|H0].
  - assert (Hst0 : 0 < cone_step psi K) by (apply Rdiv_lt_0_compat; lra).
    destruct (step_of (cone_step psi K) (- psi) x (K - 1) Hst0 ltac:(lia)) as [q [Hq Hqx]].
    { rewrite minus_INR by lia. change (INR 1) with 1. lra. }
    apply (bound_between_two_sides n u b (cone_step psi K) (- psi + INR q * cone_step psi K));
      [exact Hb|lra|exact Hqx| |].
    + apply Hsides. lia.
    + replace (- psi + INR q * cone_step psi K + cone_step psi K)
        with (- psi + INR (S q) * cone_step psi K) by (rewrite S_INR; ring).
      apply Hsides. lia.
  - specialize (Hsides 0%nat ltac:(lia)). unfold cone_step in Hsides. rewrite <- H0 in *.
    replace x with 0 by lra.
    replace (2 * 0 / (INR K - 1) / 2) with 0 in Hsides by (field; lra).
    rewrite cos_0 in Hsides. simpl INR in Hsides.
    replace (- 0 + 0 * (2 * 0 / (INR K - 1))) with 0 in Hsides by (field; lra). lra.
Qed.

(** ** The nearest point of a set around 0 is not longer than the point. *)

(** `polygon::nearest_point`: the half-planes have bounds >= 0, so with u the polygon contains all
    of the segment from 0 to u. Hence v_own, taken from the wanted twist, bounds the granted one. *)
Theorem nearest_is_not_longer (C : vec -> Prop) (target u : vec) :
  C u -> (forall k, 0 <= k <= 1 -> C (scale k u)) ->
  (forall p, C p -> norm (minus u target) <= norm (minus p target)) ->
  norm u <= norm target.
Proof.
  intros HCu Hstar Hnear.
  assert (Hdot : dot u u <= dot u target).
  { destruct (Rle_lt_dec (dot u u) (dot u target)) as [|Hlt]; [assumption|exfalso].
    pose proof (dot_pos u) as P.
    (* Shrinking u a little would come nearer. *)
    set (D := dot u u - dot u target) in *.
    assert (HD : 0 < D) by (unfold D; lra).
    set (h := Rmin 1 (D / (dot u u + 1))).
    assert (Hh : 0 < h <= 1).
    { split; [apply Rmin_glb_lt; [lra|apply Rdiv_lt_0_compat; lra]|apply Rmin_l]. }
    assert (Hh2 : h * (dot u u + 1) <= D).
    { apply Rle_trans with (D / (dot u u + 1) * (dot u u + 1)).
      - apply Rmult_le_compat_r; [lra|apply Rmin_r].
      - right. field. lra. }
    specialize (Hnear (scale (1 - h) u) (Hstar (1 - h) ltac:(lra))).
    assert (S : dot (minus u target) (minus u target)
                <= dot (minus (scale (1 - h) u) target) (minus (scale (1 - h) u) target)).
    { rewrite <- !norm_sq. pose proof (norm_pos (minus u target)). nra. }
    assert (X : dot (minus (scale (1 - h) u) target) (minus (scale (1 - h) u) target)
                = dot (minus u target) (minus u target) - 2 * h * D + h * h * dot u u).
    { unfold D. destruct u, target. unfold dot, minus, scale; simpl. ring. }
    rewrite X in S. nra. }
  pose proof (dot_le_norms u target). pose proof (norm_sq u). pose proof (norm_pos u).
  pose proof (norm_pos target).
  destruct (Rle_lt_dec (norm u) (norm target)) as [|Hlt]; [assumption|nra].
Qed.

(** ** A held twist moves the front point at hypot(v, ell w). *)

(** `formation::unicycle::arc`: the chord of the arc, and `front_point` ell ahead of the axle. *)
Definition sinc (a : R) : R := if Req_EM_T a 0 then 1 else sin a / a.
Definition arc_front (x y theta ell v w t : R) : vec :=
  let chord := v * t * sinc (w * t / 2) in
  (x + chord * cos (theta + w * t / 2) + ell * cos (theta + w * t),
   y + chord * sin (theta + w * t / 2) + ell * sin (theta + w * t)).

(** The speed counted: `formation::front_point::front_speed`. *)
Definition front_speed (ell v w : R) : R := norm (v, ell * w).

Lemma chord_closed (v w t : R) :
  w <> 0 -> v * t * sinc (w * t / 2) = 2 * v / w * sin (w * t / 2).
Proof.
  intros Hw. unfold sinc. destruct (Req_EM_T (w * t / 2) 0) as [H|H].
  - assert (t = 0) by nra. subst t. replace (w * 0 / 2) with 0 by field. rewrite sin_0. field. exact Hw.
  - assert (t <> 0) by (intro Ht; apply H; rewrite Ht; field). field. split; assumption.
Qed.

Theorem front_point_of_a_held_twist (x y theta ell v w t : R) :
  is_derive (fun s => fst (arc_front x y theta ell v w s)) t
            (fst (rotate (theta + w * t) (v, ell * w))) /\
  is_derive (fun s => snd (arc_front x y theta ell v w s)) t
            (snd (rotate (theta + w * t) (v, ell * w))).
Proof.
  destruct (Req_dec w 0) as [->|Hw].
  - assert (Hs : forall s, sinc (0 * s / 2) = 1).
    { intros s. unfold sinc. destruct (Req_EM_T (0 * s / 2) 0) as [|H]; [reflexivity|].
      exfalso. apply H. field. }
    split.
    + apply is_derive_ext with
        (fun s => x + v * s * 1 * cos (theta + 0 * s / 2) + ell * cos (theta + 0 * s)).
      { intros s. unfold arc_front. simpl. rewrite Hs. reflexivity. }
      auto_derive; [exact I|]. unfold rotate; simpl.
      replace (theta + 0 * t * / 2) with theta by field. replace (theta + 0 * t) with theta by ring.
      ring.
    + apply is_derive_ext with
        (fun s => y + v * s * 1 * sin (theta + 0 * s / 2) + ell * sin (theta + 0 * s)).
      { intros s. unfold arc_front. simpl. rewrite Hs. reflexivity. }
      auto_derive; [exact I|]. unfold rotate; simpl.
      replace (theta + 0 * t * / 2) with theta by field. replace (theta + 0 * t) with theta by ring.
      ring.
  - assert (Hhalf : theta + w * t = (theta + w * t / 2) + w * t / 2) by field.
    split.
    + apply is_derive_ext with
        (fun s => x + 2 * v / w * sin (w * s / 2) * cos (theta + w * s / 2)
                  + ell * cos (theta + w * s)).
      { intros s. unfold arc_front. simpl. rewrite chord_closed by exact Hw. reflexivity. }
      auto_derive; [exact I|]. unfold rotate; simpl.
      change (w * t * / 2) with (w * t / 2). set (a := w * t / 2) in *.
      rewrite Hhalf. set (phi := theta + a). rewrite (cos_plus phi a), (sin_plus phi a).
      field. exact Hw.
    + apply is_derive_ext with
        (fun s => y + 2 * v / w * sin (w * s / 2) * sin (theta + w * s / 2)
                  + ell * sin (theta + w * s)).
      { intros s. unfold arc_front. simpl. rewrite chord_closed by exact Hw. reflexivity. }
      auto_derive; [exact I|]. unfold rotate; simpl.
      change (w * t * / 2) with (w * t / 2). set (a := w * t / 2) in *.
      rewrite Hhalf. set (phi := theta + a). rewrite (cos_plus phi a), (sin_plus phi a).
      field. exact Hw.
Qed.

Theorem front_point_never_faster (theta ell v w : R) :
  norm (rotate theta (v, ell * w)) = front_speed ell v w.
Proof. apply rotate_norm. Qed.
