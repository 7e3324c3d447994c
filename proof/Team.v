(** Teams of different robots: each has its own body, speed limit, command timeout, braking time and sensor errors, and
    each pair its own distance and shares. Only Lambda is common. The twist of each moves on segments, or its components
    change independently. *)
Require Import Reals Lra Psatz Lia.
From Coquelicot Require Import Coquelicot.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Inertia Braking.
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
  intros HL HV HS G Hp i j t Hij Ht.
  assert (VV : forall q, never_faster_than V (robots q)).
  { intros q x Hx. destruct (HS q) as [_ [_ B]]. destruct (G q) as [_ [_ [_ [Nf _]]]].
    eapply Rle_trans; [apply Nf; exact Hx|exact B]. }
  assert (MM : forall q, moves (robots q)) by (intros q; apply (G q)).
  assert (Hshare : forall p q, p <> q -> keeps (share_ p q) (2 * L) (dist p q) (robots p) (robots q)).
  { intros p q Hpq t' g Ht' Hdist Hg.
    destruct (Hp p q Hpq) as [Hv [Hs [_ [Hd [Hst Hall]]]]].
    destruct (HS p) as [Sens [EL _]].
    set (x := Near (fun t => minus (front (robots p) t) (front (robots q) t)) (speed_ p q) (share_ p q) (dist p q)) in *.
    assert (HV0 : 0 <= v_max (S q)) by (destruct (HS q) as [[_ [_ [B _]]] _]; exact B).
    assert (Hb : moves_beside (robots p) x).
    { split; [simpl; lra|]. split; [exact Hs|]. intros s u Hsu. simpl.
      assert (HO : norm (minus (front (robots q) u) (front (robots q) s)) <= speed_ p q * (u - s)).
      { apply front_moves_at_most; [apply MM|lra|exact Hsu|]. intros y Hy.
        destruct (G q) as [_ [_ [_ [Nf _]]]]. eapply Rle_trans; [apply Nf; lra|exact Hv]. }
      assert (T : norm (minus (minus (front (robots p) u) (front (robots q) u))
                              (minus (front (robots p) s) (front (robots q) s)))
                  <= norm (minus (front (robots p) u) (front (robots p) s))
                     + norm (minus (front (robots q) s) (front (robots q) u))).
      { replace (minus (minus (front (robots p) u) (front (robots q) u))
                       (minus (front (robots p) s) (front (robots q) s)))
          with (plus (minus (front (robots p) u) (front (robots p) s))
                     (minus (front (robots q) s) (front (robots q) u))); [apply norm_plus|].
        unfold plus, minus; simpl; f_equal; ring. }
      rewrite (norm_minus_sym (front (robots q) s)) in T. lra. }
    assert (H0 : 0 <= its_slack x 0).
    { unfold its_slack, x; simpl. unfold distance in Hst. lra. }
    pose proof (share_of_the_slack_with_inertia (S p) (N p) (tau p) (robots p) (all p) x
                  Sens (G p) Hall Hb H0) as K.
    unfold keeps_its_share_of in K. rewrite EL in K.
    exact (K t' g Ht' Hdist Hg). }
  set (dm := Rmin (dist i j) (dist j i)).
  assert (Hc : forall p q, p <> q -> continuous_from_0 (rho (dist p q) (robots p) (robots q))).
  { intros p q _. apply (slack_continuous V); auto. }
  assert (Hji : j <> i) by auto.
  destruct (Hp i j Hij) as [_ [Si [Sum [Di [Sti _]]]]].
  destruct (Hp j i Hji) as [_ [Sj [_ [Dj _]]]].
  assert (Ki : keeps (share_ i j) (2 * L) dm (robots i) (robots j)).
  { apply (keeps_less _ _ (dist i j)); [lra|apply Rmin_l|apply Hc; exact Hij|apply Hshare; exact Hij]. }
  assert (Kj : keeps (share_ j i) (2 * L) dm (robots j) (robots i)).
  { apply (keeps_less _ _ (dist j i)); [lra|apply Rmin_r|apply Hc; exact Hji|apply Hshare; exact Hji]. }
  assert (Hdm : 0 < dm) by (apply Rmin_glb_lt; assumption).
  assert (H0 : dm <= distance (robots i) (robots j) 0).
  { eapply Rle_trans; [apply Rmin_l|exact Sti]. }
  apply (E_keeps_the_distance (2 * L)); [|exact H0].
  apply (core_slack _ _ dm); [lra|exact Hdm|unfold rho; lra| | |lra].
  - apply (slack_continuous V); auto.
  - intros u g Hu Hg Hhigh. apply (falls_at_most (share_ i j) (share_ j i)); auto.
    + unfold rho. lra.
    + unfold rho in Hhigh. lra.
Qed.
