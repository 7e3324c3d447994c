(** Teams of different robots: each has its own body, speed limit, command timeout, braking time and sensor errors, and
    each pair its own distance and shares. Only Lambda is common. Each robot stops at once, or brakes: then its twist
    moves on segments, or its components change independently. *)
Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Time Inertia Braking AtOnce.
Open Scope R_scope.

(** The robot uses up at most [share] of the slack: n . alpha' >= - share e^(-k t) g. *)
Definition keeps (share k dmin : R) (r o : robot) : Prop :=
  forall t g, 0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho dmin r o) k) t g ->
  - (share * exp (- k * t) * g) <= dot (direction r o t) (front_velocity r t).

Lemma falls_at_most (a b k dmin : R) (r o : robot) t g :
  moves r -> moves o -> keeps a k dmin r o -> keeps b k dmin o r -> a + b <= k ->
  0 <= rho dmin r o 0 -> 0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho dmin r o) k) t g ->
  rises_at (rho dmin r o) t (- k * exp (- k * t) * g).
Proof.
  intros Mr Mo Hr Ho Hab H0 Ht Hdist Hg.
  assert (Hg0 : 0 <= g).
  { destruct Hg as [Hall _]. pose proof (Hall 0 ltac:(lra)) as B. unfold E_of in B.
    rewrite Rmult_0_r, exp_0 in B. lra. }
  assert (Hsym : forall x, rho dmin r o x = rho dmin o r x).
  { intros x. unfold rho. rewrite distance_sym. reflexivity. }
  pose proof (Hr t g Ht Hdist Hg) as Br.
  assert (Bo : - (b * exp (- k * t) * g) <= dot (direction o r t) (front_velocity o t)).
  { apply Ho; [exact Ht|rewrite distance_sym; exact Hdist|].
    apply (running_max_ext (E_of (rho dmin r o) k)); [|exact Hg].
    intros x. unfold E_of. rewrite Hsym. reflexivity. }
  assert (Hsum : a * exp (- k * t) * g + b * exp (- k * t) * g <= k * exp (- k * t) * g).
  { assert (0 <= exp (- k * t) * g) by (apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]).
    assert ((a + b) * (exp (- k * t) * g) <= k * (exp (- k * t) * g))
      by (apply Rmult_le_compat_r; assumption). lra. }
  set (n := direction r o t) in *.
  assert (Hn : direction o r t = scale (-1) n).
  { unfold n, direction. rewrite (distance_sym o r). unfold scale, minus. simpl. f_equal; ring. }
  rewrite Hn, scale_dot in Bo.
  assert (Hunit : norm n = 1).
  { unfold n, direction. rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hdist).
    unfold distance. field. unfold distance in Hdist. lra. }
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
  assert (Hrise : rises_at f t (- k * exp (- k * t) * g)).
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

(** A robot that keeps its share for a larger distance keeps it for a smaller one: two robots may assume different
    distances. *)
Lemma keeps_less (share k more less : R) r o :
  0 <= share -> less <= more -> continuous_from_0 (rho more r o) ->
  keeps share k more r o -> keeps share k less r o.
Proof.
  intros Hs Hle Hc Hk t g Ht Hdist [Hall _].
  assert (CE : continuous_from_0 (E_of (rho more r o) k)).
  { unfold E_of. apply continuous_mult; [apply exp_line_continuous|exact Hc]. }
  destruct (last_maximum _ t CE Ht) as [m [Hm [Htop _]]].
  assert (Hmax : running_max (E_of (rho more r o) k) t (E_of (rho more r o) k m)).
  { split; [exact Htop|]. exists m. split; [exact Hm|reflexivity]. }
  pose proof (Hk t _ Ht Hdist Hmax) as B.
  assert (Hg : E_of (rho more r o) k m <= g).
  { eapply Rle_trans; [|apply (Hall m Hm)]. unfold E_of.
    apply Rmult_le_compat_l; [left; apply exp_pos|]. unfold rho. lra. }
  assert (0 <= share * exp (- k * t)) by (apply Rmult_le_pos; [exact Hs|left; apply exp_pos]).
  assert (share * exp (- k * t) * E_of (rho more r o) k m <= share * exp (- k * t) * g)
    by (apply Rmult_le_compat_l; assumption).
  lra.
Qed.

(** The other robot, with the speed, share and distance that the robot assumes for it. *)
Definition a_neighbor (r o : robot) (speed share dmin : R) : near :=
  Near (fun t => minus (front r t) (front o t)) speed share dmin.

Lemma a_neighbor_moves_beside (r o : robot) (V speed share dmin : R) :
  moves o -> never_faster_than V o -> 0 <= V <= speed -> 0 < share ->
  moves_beside r (a_neighbor r o speed share dmin).
Proof.
  intros Mo Vo HV Hs. split; [simpl; lra|]. split; [exact Hs|]. intros s u Hsu. simpl.
  assert (HO : norm (minus (front o u) (front o s)) <= speed * (u - s)).
  { apply front_moves_at_most; [exact Mo|lra|exact Hsu|]. intros y Hy.
    eapply Rle_trans; [apply Vo; lra|apply HV]. }
  assert (T : norm (minus (minus (front r u) (front o u)) (minus (front r s) (front o s)))
              <= norm (minus (front r u) (front r s)) + norm (minus (front o s) (front o u))).
  { replace (minus (minus (front r u) (front o u)) (minus (front r s) (front o s)))
      with (plus (minus (front r u) (front r s)) (minus (front o s) (front o u))); [apply norm_plus|].
    unfold plus, minus; simpl; f_equal; ring. }
  rewrite (norm_minus_sym (front o s)) in T. lra.
Qed.

(** Two robots that keep their shares keep the smaller of their distances. *)
Theorem two_shares_keep_the_smaller_distance (k a b da db V : R) (r o : robot) t :
  0 < k -> 0 <= a -> 0 <= b -> a + b <= k -> 0 < da -> 0 < db -> 0 <= V ->
  moves r -> moves o -> never_faster_than V r -> never_faster_than V o ->
  keeps a k da r o -> keeps b k db o r ->
  da <= distance r o 0 -> 0 <= t -> Rmin da db <= distance r o t.
Proof.
  intros Hk Ha Hb Hab Hda Hdb HV Mr Mo Vr Vo Kr Ko Hstart Ht. set (dm := Rmin da db).
  assert (Ki : keeps a k dm r o).
  { apply (keeps_less _ _ da); [exact Ha|apply Rmin_l|apply (slack_continuous V); assumption|exact Kr]. }
  assert (Kj : keeps b k dm o r).
  { apply (keeps_less _ _ db); [exact Hb|apply Rmin_r|apply (slack_continuous V); assumption|exact Ko]. }
  assert (Hdm : 0 < dm) by (apply Rmin_glb_lt; assumption).
  assert (H0 : dm <= distance r o 0) by (eapply Rle_trans; [apply Rmin_l|exact Hstart]).
  apply (E_keeps_the_distance k); [|exact H0].
  apply (core_slack _ _ dm); [lra|exact Hdm|unfold rho; lra| | |lra].
  - apply (slack_continuous V); assumption.
  - intros u g Hu Hg Hhigh. apply (falls_at_most a b); try assumption.
    + unfold rho. lra.
    + unfold rho in Hhigh. lra.
Qed.

(** Some robots stop at once, the others brake. *)
Theorem a_mixed_team_keeps_its_distances (I : Type) (L : R) (S : I -> braking_setting)
    (N : I -> vec -> R) (tau : I -> R) (all : I -> near -> Prop) (robots : I -> robot) (share_ dist speed_ : I -> I -> R) :
  0 < L ->
  (forall i, sensible (S i) /\ Lambda (S i) = L) ->
  (forall i, stops_at_once (S i) (all i) (robots i) \/ brakes (S i) (N i) (tau i) (all i) (robots i)) ->
  (* the speed, share and distance that robot i assumes for robot j *)
  (forall i j, i <> j -> v_max (S j) <= speed_ i j /\ 0 < share_ i j /\ share_ i j + share_ j i <= 2 * L /\
     0 < dist i j /\ dist i j <= distance (robots i) (robots j) 0 /\
     all i (a_neighbor (robots i) (robots j) (speed_ i j) (share_ i j) (dist i j))) ->
  forall i j t, i <> j -> 0 <= t -> Rmin (dist i j) (dist j i) <= distance (robots i) (robots j) t.
Proof.
  intros HL HS G Hp i j t Hij Ht.
  assert (VV : forall q, never_faster_than (v_max (S q)) (robots q)).
  { intros q. destruct (G q) as [[_ [Hobey _]]|[_ [_ [_ [Nf _]]]]]; [|exact Nf].
    intros x Hx. apply (Hobey x Hx). }
  assert (MM : forall q, moves (robots q)) by (intros q; destruct (G q) as [Q|Q]; apply Q).
  assert (V0 : forall q, 0 <= v_max (S q)) by (intros q; destruct (HS q) as [[_ [_ [B _]]] _]; exact B).
  assert (Hshare : forall p q, p <> q -> keeps (share_ p q) (2 * L) (dist p q) (robots p) (robots q)).
  { intros p q Hpq t' g Ht' Hdist Hg.
    destruct (Hp p q Hpq) as [Hv [Hs [_ [_ [Hst Hall]]]]].
    destruct (HS p) as [Sens EL]. pose proof (V0 q) as Vq.
    set (x := a_neighbor (robots p) (robots q) (speed_ p q) (share_ p q) (dist p q)) in *.
    assert (Hb : moves_beside (robots p) x).
    { apply (a_neighbor_moves_beside _ _ (v_max (S q))); [apply MM|apply VV|lra|exact Hs]. }
    assert (H0 : 0 <= its_slack x 0).
    { unfold its_slack, x; simpl. unfold distance in Hst. lra. }
    assert (K : keeps_its_share_of (S p) (robots p) x).
    { destruct (G p) as [Q|Q].
      - apply (share_of_the_slack_at_once (S p) (robots p) (all p)); assumption.
      - apply (share_of_the_slack_with_inertia (S p) (N p) (tau p) (robots p) (all p)); assumption. }
    unfold keeps_its_share_of in K. rewrite EL in K.
    exact (K t' g Ht' Hdist Hg). }
  assert (Hji : j <> i) by auto.
  destruct (Hp i j Hij) as [_ [Si [Sum [Di [Sti _]]]]].
  destruct (Hp j i Hji) as [_ [Sj [_ [Dj _]]]].
  set (V := Rmax (v_max (S i)) (v_max (S j))).
  apply (two_shares_keep_the_smaller_distance (2 * L) (share_ i j) (share_ j i) _ _ V); auto; try lra.
  - apply Rle_trans with (v_max (S i)); [apply V0|apply Rmax_l].
  - intros x Hx. eapply Rle_trans; [apply (VV i x Hx)|apply Rmax_l].
  - intros x Hx. eapply Rle_trans; [apply (VV j x Hx)|apply Rmax_r].
Qed.

Theorem a_team_keeps_its_distances (I : Type) (L V : R) (S : I -> braking_setting)
    (N : I -> vec -> R) (tau : I -> R) (all : I -> near -> Prop) (robots : I -> robot) (share_ dist speed_ : I -> I -> R) :
  0 < L -> 0 <= V ->
  (forall i, sensible (S i) /\ Lambda (S i) = L /\ v_max (S i) <= V) ->
  (forall i, brakes (S i) (N i) (tau i) (all i) (robots i)) ->
  (* the speed, share and distance that robot i assumes for robot j *)
  (forall i j, i <> j -> v_max (S j) <= speed_ i j /\ 0 < share_ i j /\ share_ i j + share_ j i <= 2 * L /\
     0 < dist i j /\ dist i j <= distance (robots i) (robots j) 0 /\
     all i (Near (fun t => minus (front (robots i) t) (front (robots j) t)) (speed_ i j) (share_ i j) (dist i j))) ->
  forall i j t, i <> j -> 0 <= t -> Rmin (dist i j) (dist j i) <= distance (robots i) (robots j) t.
Proof.
  intros HL _ HS G Hp.
  apply (a_mixed_team_keeps_its_distances I L S N tau all robots share_ dist speed_); try assumption.
  - intros i. split; apply (HS i).
  - intros i. right. apply G.
Qed.

(** Robots that stop at once: Lambda is that of the longest command timeout. *)
Theorem a_team_that_stops_at_once_keeps_its_distances (I : Type) (L : R) (S : I -> braking_setting)
    (all : I -> near -> Prop) (robots : I -> robot) (share_ dist speed_ : I -> I -> R) :
  0 < L ->
  (forall i, sensible (S i) /\ Lambda (S i) = L) ->
  (forall i, stops_at_once (S i) (all i) (robots i)) ->
  (* the speed, share and distance that robot i assumes for robot j *)
  (forall i j, i <> j -> v_max (S j) <= speed_ i j /\ 0 < share_ i j /\ share_ i j + share_ j i <= 2 * L /\
     0 < dist i j /\ dist i j <= distance (robots i) (robots j) 0 /\
     all i (a_neighbor (robots i) (robots j) (speed_ i j) (share_ i j) (dist i j))) ->
  forall i j t, i <> j -> 0 <= t -> Rmin (dist i j) (dist j i) <= distance (robots i) (robots j) t.
Proof.
  intros HL HS G Hp.
  apply (a_mixed_team_keeps_its_distances I L S (fun _ _ => 0) (fun _ => 0) all robots share_ dist speed_); try assumption.
  intros i. left. apply G.
Qed.
