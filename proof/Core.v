(** What never falls: if E is continuous, g is its running maximum, and E' >= -2 Lambda (g - E)
    from the right, then E never falls.

    Derivatives are taken from the right and only bounded from below ("rises_at"). That is what a
    robot has at *every* instant, also where its command changes: wheels that switch at time t have
    some speed after t. So no instant needs to be left out, and E need not be differentiable. *)

Require Import Reals Lra Psatz.
Open Scope R_scope.

(** Continuity on t >= 0. Nothing is said of earlier times. *)
Definition continuous_from_0 (f : R -> R) : Prop :=
  forall t, 0 <= t -> forall e, 0 < e ->
  exists del, 0 < del /\
    forall s, 0 <= s -> Rabs (s - t) < del -> Rabs (f s - f t) < e.

(** From t on, f rises at least at the rate l: its lower right derivative at t is l or more. *)
Definition rises_at (f : R -> R) (t l : R) : Prop :=
  forall e, 0 < e ->
  exists del, 0 < del /\ forall h, 0 < h < del -> f t + (l - e) * h <= f (t + h).

(** G is the largest value of E so far. *)
Definition running_max (E : R -> R) (t G : R) : Prop :=
  (forall s, 0 <= s <= t -> E s <= G) /\ exists s, 0 <= s <= t /\ E s = G.

(** ** A function that rises at rate 0 or more at every instant does not fall. *)

Lemma below_sup (S : R -> Prop) m s :
  is_lub S m -> s < m -> exists x, S x /\ s < x.
Proof.
  intros [_ Hleast] Hs.
  destruct (Classical_Prop.classic (exists x, S x /\ s < x)) as [?|Hno]; [assumption|].
  exfalso. apply (Rlt_not_le _ _ Hs). apply Hleast.
  intros x Hx. destruct (Rle_lt_dec x s) as [|Hlt]; [assumption|].
  exfalso. apply Hno. exists x. split; assumption.
Qed.

Lemma never_falls (f : R -> R) (a b : R) :
  continuous_from_0 f -> 0 <= a <= b ->
  (forall t, a <= t < b -> rises_at f t 0) -> f a <= f b.
Proof.
  intros Hc [Ha Hab] Hrise.
  assert (Hslow : forall e, 0 < e -> f a - e * (b - a) <= f b).
  { intros e He.
    set (S := fun x => a <= x <= b /\ forall s, a <= s <= x -> f a - e * (s - a) <= f s).
    assert (HSa : S a).
    { split; [lra|]. intros s Hs. replace s with a by lra. lra. }
    destruct (completeness S) as [m Hm].
    - exists b. intros x [[_ Hx] _]. exact Hx.
    - exists a. exact HSa.
    - assert (Ham : a <= m) by (apply (proj1 Hm); exact HSa).
      assert (Hmb : m <= b) by (apply (proj2 Hm); intros x [[_ Hx] _]; exact Hx).
      assert (Hbelow : forall s, a <= s < m -> f a - e * (s - a) <= f s).
      { intros s [Hs1 Hs2]. destruct (below_sup S m s Hm Hs2) as [x [[_ Hx] Hsx]].
        apply Hx. lra. }
      assert (Hatm : f a - e * (m - a) <= f m).
      { destruct (Rle_lt_dec (f a - e * (m - a)) (f m)) as [|Hlt]; [assumption|].
        destruct (Rle_lt_or_eq_dec a m Ham) as [Hlt'|Heq].
        - destruct (Hc m ltac:(lra) (f a - e * (m - a) - f m) ltac:(lra)) as [del [Hdel Hnear]].
          set (s := Rmax a (m - del / 2)).
          assert (Hs : a <= s < m).
          { split; [apply Rmax_l|]. apply Rmax_lub_lt; lra. }
          assert (Hs' : m - del / 2 <= s) by apply Rmax_r.
          specialize (Hbelow s Hs).
          specialize (Hnear s ltac:(lra) ltac:(rewrite Rabs_left; lra)).
          apply Rabs_def2 in Hnear. nra.
        - subst m. lra. }
      destruct (Rle_lt_or_eq_dec m b Hmb) as [Hlt|Heq]; [|subst m; exact Hatm].
      exfalso.
      destruct (Hrise m ltac:(lra) e He) as [del [Hdel Hstep]].
      set (h := Rmin (del / 2) (b - m)).
      assert (Hh : 0 < h) by (apply Rmin_glb_lt; lra).
      assert (Hh1 : h <= del / 2) by apply Rmin_l.
      assert (Hh2 : h <= b - m) by apply Rmin_r.
      assert (HS : S (m + h)).
      { split; [lra|]. intros s Hs. destruct (Rle_lt_dec s m) as [Hle|Hgt].
        - destruct (Rle_lt_or_eq_dec s m Hle) as [H|H]; [apply Hbelow; lra|subst s; exact Hatm].
        - specialize (Hstep (s - m) ltac:(lra)).
          replace (m + (s - m)) with s in Hstep by ring. nra. }
      pose proof (proj1 Hm _ HS). lra. }
  destruct (Rle_lt_dec (f a) (f b)) as [|Hlt]; [assumption|].
  exfalso.
  specialize (Hslow ((f a - f b) / (2 * (b - a + 1)))).
  assert (Hp : 0 < b - a + 1) by lra.
  assert (0 < (f a - f b) / (2 * (b - a + 1))) by (apply Rdiv_lt_0_compat; lra).
  specialize (Hslow H).
  assert ((f a - f b) / (2 * (b - a + 1)) * (b - a) <= (f a - f b) / 2).
  { replace ((f a - f b) / 2) with ((f a - f b) / (2 * (b - a + 1)) * (b - a + 1)) by (field; lra).
    apply Rmult_le_compat_l; lra. }
  lra.
Qed.

(** ** A continuous function has a last maximum on [0, T]. *)

Lemma last_maximum (E : R -> R) (T : R) :
  continuous_from_0 E -> 0 <= T ->
  exists m, 0 <= m <= T /\ (forall s, 0 <= s <= T -> E s <= E m) /\
            (forall s, m < s <= T -> E s < E m).
Proof.
  intros Hc HT.
  (* E, held at its first value before t = 0, is continuous there too. *)
  set (F := fun t => E (Rmax 0 t)).
  destruct (continuity_ab_maj F 0 T HT) as [x [Hmax Hx]].
  { intros c [Hc0 _] e He.
    destruct (Hc c Hc0 e He) as [del [Hdel Hnear]].
    exists del. split; [exact Hdel|]. intros y [_ Hy]. simpl in *. unfold R_dist in *.
    unfold F. rewrite (Rmax_right 0 c Hc0).
    apply Hnear; [apply Rmax_l|].
    unfold Rmax; destruct (Rle_dec 0 y); [exact Hy|].
    unfold Rabs in *; destruct (Rcase_abs (0 - c)); destruct (Rcase_abs (y - c)); lra. }
  set (S := fun y => 0 <= y <= T /\ E y = E x).
  assert (HF : forall c, 0 <= c -> F c = E c) by (intros; unfold F; rewrite Rmax_right; auto).
  assert (HSx : S x) by (split; [exact Hx|reflexivity]).
  destruct (completeness S) as [m Hm].
  - exists T. intros y [[_ Hy] _]. exact Hy.
  - exists x. exact HSx.
  - assert (Hxm : x <= m) by (apply (proj1 Hm); exact HSx).
    assert (HmT : m <= T) by (apply (proj2 Hm); intros y [[_ Hy] _]; exact Hy).
    assert (Htop : forall s, 0 <= s <= T -> E s <= E x).
    { intros s Hs. rewrite <- (HF s) by lra. rewrite <- (HF x) by lra. apply Hmax. exact Hs. }
    assert (HEm : E m = E x).
    { apply Rle_antisym; [apply Htop; lra|].
      destruct (Rle_lt_dec (E x) (E m)) as [|Hlt]; [assumption|]. exfalso.
      destruct (Hc m ltac:(lra) (E x - E m) ltac:(lra)) as [del [Hdel Hnear]].
      destruct (below_sup S m (m - del) Hm ltac:(lra)) as [y [HSy Hy]].
      assert (y <= m) by (apply (proj1 Hm); exact HSy).
      destruct HSy as [Hy0 HEy].
      specialize (Hnear y ltac:(lra) ltac:(unfold Rabs; destruct (Rcase_abs (y - m)); lra)).
      apply Rabs_def2 in Hnear. lra. }
    exists m. split; [lra|]. rewrite HEm. split; [exact Htop|].
    intros s Hs. specialize (Htop s ltac:(lra)).
    destruct (Rle_lt_or_eq_dec _ _ Htop) as [|Heq]; [assumption|]. exfalso.
    assert (s <= m) by (apply (proj1 Hm); split; [lra|exact Heq]). lra.
Qed.

(** If E can never be left behind right after a maximum, E never falls. *)
Lemma never_falls_from_a_maximum (E : R -> R) :
  continuous_from_0 E ->
  (forall m T, 0 <= m < T -> (forall s, 0 <= s <= T -> E s <= E m) ->
     exists t, m < t <= T /\ E m <= E t) ->
  forall s t, 0 <= s <= t -> E s <= E t.
Proof.
  intros Hc Hafter s t Hst.
  destruct (last_maximum E t Hc ltac:(lra)) as [m [Hm [Htop Hlast]]].
  destruct (Rle_lt_or_eq_dec m t (proj2 Hm)) as [Hlt|Heq].
  - exfalso. destruct (Hafter m t ltac:(lra) Htop) as [u [Hu Hge]].
    specialize (Hlast u Hu). lra.
  - subst m. apply Htop. exact Hst.
Qed.

Lemma running_max_after (E : R -> R) m T t :
  0 <= m -> (forall s, 0 <= s <= T -> E s <= E m) -> m <= t <= T -> running_max E t (E m).
Proof.
  intros Hm Htop Ht. split.
  - intros s Hs. apply Htop. lra.
  - exists m. split; [lra|reflexivity].
Qed.

(** ** Continuity of what the proofs use. *)

Lemma continuous_of_continuity (f : R -> R) : continuity f -> continuous_from_0 f.
Proof.
  intros Hf t Ht e He. destruct (Hf t e He) as [del [Hdel Hnear]].
  exists del. split; [exact Hdel|]. intros s Hs Hst.
  destruct (Req_dec s t) as [->|Hne].
  - rewrite Rminus_eq_0, Rabs_R0. exact He.
  - apply Hnear. split; [split; [exact I|auto]|exact Hst].
Qed.

Lemma continuous_minus (f g : R -> R) :
  continuous_from_0 f -> continuous_from_0 g -> continuous_from_0 (fun t => f t - g t).
Proof.
  intros Hf Hg t Ht e He.
  destruct (Hf t Ht (e / 2) ltac:(lra)) as [d1 [H1 N1]].
  destruct (Hg t Ht (e / 2) ltac:(lra)) as [d2 [H2 N2]].
  exists (Rmin d1 d2). split; [apply Rmin_glb_lt; assumption|].
  intros s Hs Hst. pose proof (Rmin_l d1 d2). pose proof (Rmin_r d1 d2).
  specialize (N1 s Hs ltac:(lra)). specialize (N2 s Hs ltac:(lra)).
  apply Rabs_def2 in N1. apply Rabs_def2 in N2. apply Rabs_def1; lra.
Qed.

Lemma continuous_mult (f g : R -> R) :
  continuous_from_0 f -> continuous_from_0 g -> continuous_from_0 (fun t => f t * g t).
Proof.
  intros Hf Hg t Ht e He.
  pose proof (Rabs_pos (f t)). pose proof (Rabs_pos (g t)).
  set (a := Rmin 1 (e / (2 * (Rabs (g t) + 1)))).
  set (b := e / (2 * (Rabs (f t) + 1))).
  assert (Ha : 0 < a) by (apply Rmin_glb_lt; [lra|apply Rdiv_lt_0_compat; lra]).
  assert (Hb : 0 < b) by (apply Rdiv_lt_0_compat; lra).
  assert (Ha1 : a <= 1) by apply Rmin_l.
  assert (Ha2 : a * (Rabs (g t) + 1) <= e / 2).
  { replace (e / 2) with (e / (2 * (Rabs (g t) + 1)) * (Rabs (g t) + 1)) by (field; lra).
    apply Rmult_le_compat_r; [lra|apply Rmin_r]. }
  assert (Hb2 : b * (Rabs (f t) + 1) = e / 2) by (unfold b; field; lra).
  destruct (Hf t Ht a Ha) as [d1 [H1 N1]].
  destruct (Hg t Ht b Hb) as [d2 [H2 N2]].
  exists (Rmin d1 d2). split; [apply Rmin_glb_lt; assumption|].
  intros s Hs Hst. pose proof (Rmin_l d1 d2). pose proof (Rmin_r d1 d2).
  specialize (N1 s Hs ltac:(lra)). specialize (N2 s Hs ltac:(lra)).
  replace (f s * g s - f t * g t)
    with ((f s - f t) * g t + (f s - f t + f t) * (g s - g t)) by ring.
  eapply Rle_lt_trans; [apply Rabs_triang|]. rewrite !Rabs_mult.
  pose proof (Rabs_triang (f s - f t) (f t)).
  pose proof (Rabs_pos (f s - f t)). pose proof (Rabs_pos (g s - g t)).
  assert (Rabs (f s - f t) * Rabs (g t) <= a * Rabs (g t)) by (apply Rmult_le_compat_r; lra).
  assert (Rabs (f s - f t + f t) * Rabs (g s - g t) <= (1 + Rabs (f t)) * Rabs (g s - g t))
    by (apply Rmult_le_compat_r; lra).
  assert ((1 + Rabs (f t)) * Rabs (g s - g t) < (1 + Rabs (f t)) * b)
    by (apply Rmult_lt_compat_l; lra).
  lra.
Qed.

Lemma exp_line_continuous (k : R) : continuous_from_0 (fun t => exp (k * t)).
Proof.
  apply continuous_of_continuity. apply derivable_continuous.
  apply (derivable_comp (fun t => k * t) exp); [|apply derivable_exp].
  apply derivable_mult; [apply derivable_const|apply derivable_id].
Qed.

(** ** Two facts on e^(-k x). *)

Lemma exp_decay_le_1 (k x : R) : 0 <= k -> 0 <= x -> exp (- k * x) <= 1.
Proof.
  intros Hk Hx. assert (0 <= k * x) by (apply Rmult_le_pos; assumption).
  rewrite <- exp_0. destruct (Req_dec (k * x) 0) as [H0|H0].
  - replace (- k * x) with 0 by lra. lra.
  - left. apply exp_increasing. lra.
Qed.

Lemma exp_decay_line (k x : R) : exp (- k * x) * (1 + k * x) <= 1.
Proof.
  apply Rle_trans with (exp (- k * x) * exp (k * x)).
  - apply Rmult_le_compat_l; [left; apply exp_pos|apply exp_ineq1_le].
  - rewrite <- exp_plus. replace (- k * x + k * x) with 0 by ring. rewrite exp_0. lra.
Qed.

(** ** The core, as published. *)

(** The step needs E' only where E is above E(0) - c, for some c > 0: where two robots coincide,
    the distance has no derivative, and this says that it need not. *)
Theorem core (E : R -> R) (k c : R) :
  0 <= k -> 0 < c -> continuous_from_0 E ->
  (forall t g, 0 <= t -> running_max E t g -> E 0 - c < E t -> rises_at E t (- k * (g - E t))) ->
  forall s t, 0 <= s <= t -> E s <= E t.
Proof.
  intros Hk Hcpos Hc Hrise. apply never_falls_from_a_maximum; [exact Hc|].
  intros m T Hm Htop. set (G := E m) in *.
  destruct (Hc m ltac:(lra) c Hcpos) as [del [Hdel Hnear]].
  assert (H0 : E 0 <= G) by (apply Htop; lra).
  set (u := Rmin T (m + del / 2)).
  assert (Hu : m < u) by (apply Rmin_glb_lt; lra).
  assert (HuT : u <= T) by apply Rmin_l.
  assert (Hud : u <= m + del / 2) by apply Rmin_r.
  exists u. split; [lra|].
  set (f := fun t => exp (- k * t) * (E t - G)).
  assert (Hf : f m <= f u).
  { apply never_falls; [|lra|].
    - apply continuous_mult; [apply exp_line_continuous|].
      apply continuous_minus; [exact Hc|apply continuous_of_continuity, continuity_const].
      intros x y. reflexivity.
    - intros t Ht e He.
      assert (Hrun : running_max E t G) by (apply (running_max_after E m T); [lra|exact Htop|lra]).
      assert (Hhigh : E 0 - c < E t).
      { specialize (Hnear t ltac:(lra) ltac:(rewrite Rabs_pos_eq; lra)).
        apply Rabs_def2 in Hnear. fold G in Hnear. lra. }
      destruct (Hrise t G ltac:(lra) Hrun Hhigh e He) as [h0 [Hh0 Hstep]].
      exists h0. split; [exact Hh0|]. intros h Hh. specialize (Hstep h Hh). unfold f.
      replace (- k * (t + h)) with (- k * t + - k * h) by ring. rewrite exp_plus.
      set (D := G - E t).
      assert (HD : 0 <= D) by (unfold D; pose proof (proj1 Hrun t); lra).
      assert (Hone : exp (- k * t) <= 1) by (apply exp_decay_le_1; lra).
      assert (Hdecay := exp_decay_line k h).
      assert (Hone' : exp (- k * h) <= 1) by (apply exp_decay_le_1; lra).
      pose proof (exp_pos (- k * t)) as P1. pose proof (exp_pos (- k * h)) as P2.
      assert (A : E t + (- k * (G - E t) - e) * h - G = - (D * (1 + k * h) + e * h))
        by (unfold D; ring).
      assert (B : exp (- k * h) * (E (t + h) - G) >= - (D + e * h)).
      { apply Rle_ge. apply Rle_trans with (exp (- k * h) * (- (D * (1 + k * h) + e * h))).
        - assert (exp (- k * h) * (e * h) <= 1 * (e * h)) by (apply Rmult_le_compat_r; nra).
          assert (D * (exp (- k * h) * (1 + k * h)) <= D * 1) by (apply Rmult_le_compat_l; lra).
          nra.
        - apply Rmult_le_compat_l; lra. }
      assert (exp (- k * t) * (e * h) <= 1 * (e * h)) by (apply Rmult_le_compat_r; nra).
      assert (exp (- k * t) * (exp (- k * h) * (E (t + h) - G)) >= exp (- k * t) * (- (D + e * h)))
        by (apply Rle_ge, Rmult_le_compat_l; lra).
      rewrite Rmult_assoc. unfold D in *. nra. }
  unfold f in Hf. fold G in Hf. rewrite Rminus_eq_0, Rmult_0_r in Hf.
  pose proof (exp_pos (- k * u)). nra.
Qed.

(** ** The core in terms of the slack rho, E = e^(k t) rho, k = 2 Lambda.

    E' >= -k (g - E) says the same as rho' >= -k e^(-k t) g, which is how two robots provide it. *)

Definition E_of (rho : R -> R) (k t : R) : R := exp (k * t) * rho t.

Theorem core_slack (rho : R -> R) (k c : R) :
  0 <= k -> 0 < c -> 0 <= rho 0 -> continuous_from_0 rho ->
  (forall t g, 0 <= t -> running_max (E_of rho k) t g -> - c < rho t ->
     rises_at rho t (- k * exp (- k * t) * g)) ->
  forall s t, 0 <= s <= t -> E_of rho k s <= E_of rho k t.
Proof.
  intros Hk Hcpos Hstart Hc Hrise.
  assert (HcE : continuous_from_0 (E_of rho k))
    by (apply continuous_mult; [apply exp_line_continuous|exact Hc]).
  apply never_falls_from_a_maximum; [exact HcE|].
  intros m T Hm Htop. set (G := E_of rho k m) in *.
  destruct (Hc m ltac:(lra) c Hcpos) as [del [Hdel Hnear]].
  assert (HG : 0 <= G).
  { apply Rle_trans with (E_of rho k 0); [|apply Htop; lra].
    unfold E_of. rewrite Rmult_0_r, exp_0. lra. }
  assert (Hrho : rho m = exp (- k * m) * G).
  { unfold G, E_of. rewrite <- Rmult_assoc, <- exp_plus.
    replace (- k * m + k * m) with 0 by ring. rewrite exp_0. ring. }
  assert (Hrhom : 0 <= rho m).
  { rewrite Hrho. apply Rmult_le_pos; [left; apply exp_pos|exact HG]. }
  set (u := Rmin T (m + del / 2)).
  assert (Hu : m < u) by (apply Rmin_glb_lt; lra).
  assert (HuT : u <= T) by apply Rmin_l.
  assert (Hud : u <= m + del / 2) by apply Rmin_r.
  exists u. split; [lra|].
  set (f := fun t => rho t - exp (- k * t) * G).
  assert (Hf : f m <= f u).
  { apply never_falls; [|lra|].
    - apply continuous_minus; [exact Hc|]. apply continuous_mult; [apply exp_line_continuous|].
      apply continuous_of_continuity, continuity_const. intros x y. reflexivity.
    - intros t Ht e He.
      assert (Hrun : running_max (E_of rho k) t G)
        by (apply (running_max_after (E_of rho k) m T); [lra|exact Htop|lra]).
      assert (Hhigh : - c < rho t).
      { specialize (Hnear t ltac:(lra) ltac:(rewrite Rabs_pos_eq; lra)).
        apply Rabs_def2 in Hnear. lra. }
      (* e^(-k (t + h)) <= e^(-k t) (1 - k h + (k h)^2): spend half of e on the square. *)
      set (A := exp (- k * t) * G).
      assert (HA : 0 <= A) by (apply Rmult_le_pos; [left; apply exp_pos|exact HG]).
      destruct (Hrise t G ltac:(lra) Hrun Hhigh (e / 2) ltac:(lra)) as [h0 [Hh0 Hstep]].
      set (h1 := e / 2 / (A * k * k + 1)).
      assert (Hden : 0 < A * k * k + 1) by (assert (0 <= A * (k * k)) by (apply Rmult_le_pos; nra); nra).
      assert (Hh1 : 0 < h1) by (apply Rdiv_lt_0_compat; lra).
      exists (Rmin h0 h1). split; [apply Rmin_glb_lt; assumption|].
      intros h Hh. pose proof (Rmin_l h0 h1). pose proof (Rmin_r h0 h1).
      specialize (Hstep h ltac:(lra)). unfold f.
      replace (- k * (t + h)) with (- k * t + - k * h) by ring. rewrite exp_plus.
      assert (Hexp : exp (- k * h) <= 1 - k * h + (k * h) * (k * h)).
      { (* e^(-x) <= 1/(1 + x) <= 1 - x + x^2 *)
        assert (Hx : 0 <= k * h) by nra.
        assert (Hdecay := exp_decay_line k h).
        apply Rmult_le_reg_r with (1 + k * h); [lra|].
        apply Rle_trans with 1; [exact Hdecay|].
        assert (0 <= (k * h) * ((k * h) * (k * h)))
          by (apply Rmult_le_pos; [|apply Rmult_le_pos]; lra). nra. }
      assert (Hsq : A * ((k * h) * (k * h)) <= e / 2 * h).
      { assert (HH : h * (A * k * k + 1) <= e / 2).
        { replace (e / 2) with (h1 * (A * k * k + 1)) by (unfold h1; field; lra).
          apply Rmult_le_compat_r; lra. }
        nra. }
      assert (HAe : exp (- k * t) * exp (- k * h) * G <= A * (1 - k * h + (k * h) * (k * h))).
      { replace (exp (- k * t) * exp (- k * h) * G) with (A * exp (- k * h)) by (unfold A; ring).
        apply Rmult_le_compat_l; assumption. }
      fold A. replace (- k * exp (- k * t) * G) with (- k * A) in Hstep by (unfold A; ring).
      nra. }
  unfold f in Hf. rewrite Hrho, Rminus_eq_0 in Hf.
  unfold E_of. replace G with (exp (k * u) * (exp (- k * u) * G)).
  - apply Rmult_le_compat_l; [left; apply exp_pos|lra].
  - rewrite <- Rmult_assoc, <- exp_plus. replace (k * u + - k * u) with 0 by ring.
    rewrite exp_0. ring.
Qed.

(** So the slack never becomes negative. *)
Corollary slack_stays_nonnegative (rho : R -> R) (k c : R) :
  0 <= k -> 0 < c -> 0 <= rho 0 -> continuous_from_0 rho ->
  (forall t g, 0 <= t -> running_max (E_of rho k) t g -> - c < rho t ->
     rises_at rho t (- k * exp (- k * t) * g)) ->
  forall t, 0 <= t -> 0 <= rho t.
Proof.
  intros Hk Hcpos Hstart Hc Hrise t Ht.
  pose proof (core_slack rho k c Hk Hcpos Hstart Hc Hrise 0 t ltac:(lra)) as HE.
  unfold E_of in HE. rewrite Rmult_0_r, exp_0, Rmult_1_l in HE.
  pose proof (exp_pos (k * t)). nra.
Qed.
