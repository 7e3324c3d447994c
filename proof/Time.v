(** At every instant, for every robot and for any losses, delays, stops and restarts: the robot uses up at most
    its half of the slack,

        n(t) . alpha'(t) >= - Lambda e^(-2 Lambda t) g(t),

    where g is the running maximum of E = e^(2 Lambda t) rho, and rho the distance minus d. *)

Require Import Reals Lra Psatz Lia.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard.
Open Scope R_scope.

(** ** Guarantees of the agent. *)

(** The command is zero: `Twist::ZERO`, the answer without known neighbors or without a certificate. A command that
    only turns the robot in place is not zero: it may turn the robot while an older twist is still in force. *)
Definition stands (c : command) : Prop := speed c = 0 /\ across c = 0 /\ turn c = 0.

(** Bounds v_own and turn rates that cover the command and every earlier command that may still be in effect.
    The agent knows those of its own process (`unexpired_commands`). Of an earlier process it only knows that
    the plant limits the speed to v_max. *)
Definition covers_the_alive (S : setting) (r : robot) (k : nat) (v_own w_low w_high : R) : Prop :=
  forall l, (l < k)%nat -> stamp (computed r k) < stamp (computed r l) + lifetime S ->
  (incarnation (computed r l) = incarnation (computed r k) ->
     covers v_own w_low w_high (computed r l)) /\
  (incarnation (computed r l) <> incarnation (computed r k) ->
     v_max S <= v_own /\ w_low <= - spin r /\ spin r <= w_high).

(** Command k of robot r is zero, or certified against every other robot. *)
Definition certified (S : setting) (r : robot) (others : robot -> Prop) (k : nat) : Prop :=
  let c := computed r k in
  stands c \/
  exists v_own w_low w_high,
    0 <= v_own <= v_max S /\ w_low <= 0 <= w_high /\
    covers v_own w_low w_high c /\
    covers_the_alive S r k v_own w_low w_high /\
    forall o, others o ->
      respects S v_own w_low w_high (heading r (stamp c)) c
               (minus (front r (stamp c)) (front o (stamp c))).

(** Requirements on one robot. *)
Definition guarded (S : setting) (others : robot -> Prop) (r : robot) : Prop :=
  moves r /\
  obeys (lifetime S) (v_max S) r /\
  chronological (mail r) /\
  one_living_incarnation (computed r) /\
  sent_by (computed r) (mail r) /\
  forall k, 0 <= stamp (computed r k) /\ certified S r others k.

(** ** Commands of an earlier process, after a restart. *)

(** `Guard::drop_expired_commands` sets `predecessor_end_ns` to the first stamp + H: until then the guard assumes v_max
    and +-v_max/ell. This is long enough. *)
Theorem after_the_first_lifetime_no_predecessor_is_alive (computed : nat -> command) (h : R) f k l :
  one_living_incarnation computed ->
  (* f is the first of its incarnation, which is that of k *)
  incarnation (computed f) = incarnation (computed k) ->
  (forall l, (l < f)%nat -> incarnation (computed l) <> incarnation (computed f)) ->
  (l < k)%nat -> incarnation (computed l) <> incarnation (computed k) ->
  stamp (computed k) < stamp (computed l) + h ->
  stamp (computed k) < stamp (computed f) + h.
Proof.
  intros Hone Hf _ Hlk Hdiff Halive.
  assert (Hinc := incarnations_in_order computed l k Hone ltac:(lia)).
  assert (Hlf : (l < f)%nat).
  { destruct (Compare_dec.le_lt_dec f l) as [Hfl|]; [exfalso|assumption].
    pose proof (incarnations_in_order computed f l Hone Hfl). lia. }
  destruct (Hone l f Hlf) as [_ Hst]. lra.
Qed.

(** In lockstep H = T, and a restarted process answers later ticks only: all commands of its predecessor have
    expired, so `may_have_predecessor` is not needed. *)
Theorem in_lockstep_no_command_of_an_earlier_tick_is_alive (T : R) (earlier later : nat) :
  0 < T -> (earlier < later)%nat -> ~ INR later * T < INR earlier * T + T.
Proof.
  intros HT Hlt Halive. apply le_INR in Hlt. rewrite S_INR in Hlt.
  assert ((INR earlier + 1) * T <= INR later * T) by (apply Rmult_le_compat_r; lra). lra.
Qed.

(** ** Motion between the sample of the command in force and the current time. *)

Lemma part_of_a_command a b lam : 0 <= lam <= 1 -> norm (lam * a, lam * b) <= norm (a, b).
Proof.
  intros Hlam. replace (lam * a, lam * b) with (scale lam (a, b)) by reflexivity.
  rewrite norm_scale by lra. pose proof (norm_pos (a, b)). nra.
Qed.

Lemma wheels_since_the_sample (S : setting) (r : robot) others k v_own w_low w_high t tau :
  sensible S -> guarded S others r -> 0 <= v_own -> w_low <= 0 <= w_high ->
  covers v_own w_low w_high (computed r k) ->
  covers_the_alive S r k v_own w_low w_high ->
  in_force (lifetime S) (mail r) t = Some (computed r k) ->
  stamp (computed r k) <= tau <= t ->
  norm (v r tau, side r tau) <= v_own /\ w_low <= w r tau <= w_high.
Proof.
  intros HS [_ [Hobey [Hchron [Hone [Hsent Hall]]]]] Hown Hw Hcov Halive Hforce Htau.
  destruct (Hall k) as [Hs0 _].
  destruct (Hobey tau ltac:(lra)) as [Hmax [Hspin Hdoes]].
  assert (Hpart : forall c, covers v_own w_low w_high c ->
    forall lam part, 0 <= lam <= 1 -> 0 <= part <= 1 -> v r tau = lam * speed c -> side r tau = lam * across c ->
    w r tau = part * turn c ->
    norm (v r tau, side r tau) <= v_own /\ w_low <= w r tau <= w_high).
  { intros c [C1 C2] lam part Hlam Hpart -> -> ->. split.
    - apply Rle_trans with (norm (speed c, across c)); [|exact C1].
      apply part_of_a_command. exact Hlam.
    - split; nra. }
  destruct (in_force (lifetime S) (mail r) tau) as [c'|] eqn:Hc'.
  - destruct Hdoes as [lam [Hlam [Hv [Hsd [part [Hprt Hwt]]]]]].
    destruct (who_acted_since_the_sample (lifetime S) (mail r) (computed r) t tau k c'
                Hchron Hone Hsent Hforce Htau Hc') as [-> | [l [Hlk [-> Hl]]]].
    + apply (Hpart (computed r k) Hcov lam part); assumption.
    + destruct (Halive l Hlk Hl) as [Hsame Hother].
      destruct (Nat.eq_dec (incarnation (computed r l)) (incarnation (computed r k))) as [E|E].
      * apply (Hpart (computed r l) (Hsame E) lam part); assumption.
      * destruct (Hother E) as [V1 [V2 V3]].
        split; lra.
  - destruct Hdoes as [-> [-> ->]].
    assert (norm (0, 0) = 0) as -> by (unfold norm, dot; simpl; rewrite !Rmult_0_l, Rplus_0_l; apply sqrt_0).
    lra.
Qed.

(** ** The bound at every instant. *)

Theorem share_of_the_slack (S : setting) (r o : robot) (others : robot -> Prop) (t g : R) :
  sensible S -> guarded S others r -> others o ->
  (* of the other robot only that it moves and keeps the speed limit *)
  moves o -> obeys (lifetime S) (v_max S) o ->
  0 <= rho (d S) r o 0 -> 0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho (d S) r o) (2 * rate (lifetime S))) t g ->
  - (rate (lifetime S) * exp (- (2 * rate (lifetime S)) * t) * g) <= dot (direction r o t) (front_velocity r t).
Proof.
  intros HS Hr Ho Hmo Hobeyo Hstart Ht Hdist Hg.
  pose proof HS as [HH [HV [Hd [Heps [Heta Hrnd]]]]].
  pose proof (rate_pos (lifetime S) HH) as HL. pose proof (rate_times_H (lifetime S) HH) as HLH.
  set (L := rate (lifetime S)) in *. set (k2 := 2 * L) in *.
  destruct (slack_so_far (rho (d S) r o) k2 t g Hstart Ht Hg) as [Hg0 Hslack].
  assert (Henough : forall b, b <= L * (exp (- k2 * t) * g) ->
            - b <= dot (direction r o t) (front_velocity r t) ->
            - (L * exp (- k2 * t) * g) <= dot (direction r o t) (front_velocity r t)).
  { intros b Hb Hdot. lra. }
  assert (Hzero : 0 <= L * (exp (- k2 * t) * g)).
  { apply Rmult_le_pos; [lra|]. apply Rmult_le_pos; [left; apply exp_pos|exact Hg0]. }
  pose proof Hr as [Hmr [Hobeyr [Hchron [Hone [Hsent Hall]]]]].
  destruct (Hobeyr t Ht) as [_ [_ Hdoes]].
  assert (Hstill : v r t = 0 -> side r t = 0 ->
            - (L * exp (- k2 * t) * g) <= dot (direction r o t) (front_velocity r t)).
  { intros Hv Hw. apply (Henough 0); [lra|]. unfold front_velocity. rewrite Hv, Hw.
    unfold dot, rotate; simpl. lra. }
  destruct (in_force (lifetime S) (mail r) t) as [c|] eqn:Hc; [|destruct Hdoes as [? [? _]]; apply Hstill; assumption].
  destruct Hdoes as [lam [Hlam [Hv [Hw _]]]].
  destruct (acts_within_its_lifetime (lifetime S) (mail r) t c Hchron Hc) as [Hlife [m Hm]].
  destruct (Hsent m) as [k Hk]. rewrite Hk in Hm. subst c. clear m Hk.
  destruct (Hall k) as [Hs0 [Hstands | [v_own [lo [hi [Hown [Hlohi [Hcov [Halive Hresp]]]]]]]]].
  { destruct Hstands as [S1 [S2 _]]. rewrite S1, S2 in *. apply Hstill; lra. }
  set (c := computed r k) in *. set (s := stamp c) in *.
  assert (Hsince : forall tau, s <= tau < t ->
            norm (v r tau, side r tau) <= v_own /\ lo <= w r tau <= hi).
  { intros tau Htau.
    apply (wheels_since_the_sample S r others k v_own lo hi t tau); try assumption; try lra.
    fold c. fold s. lra. }
  assert (Hown_moved : norm (minus (front r t) (front r s)) <= v_own * (t - s)).
  { apply front_moves_at_most; [exact Hmr|lra|lra|]. intros x Hx. apply (Hsince x Hx). }
  assert (Hother_moved : norm (minus (front o t) (front o s)) <= v_max S * (t - s)).
  { apply front_moves_at_most; [exact Hmo|lra|lra|]. intros x Hx. apply (Hobeyo x). lra. }
  assert (Hturned : lo * (t - s) <= heading r t - heading r s <= hi * (t - s)).
  { apply heading_turns_within; [exact Hmr|lra|]. intros x Hx. apply (Hsince x Hx). }
  set (z := minus (front r t) (front o t)).
  set (zs := minus (front r s) (front o s)).
  assert (Hmoved : norm (minus z zs) <= (v_max S + v_own) * lifetime S).
  { assert (T : norm (minus z zs)
                <= norm (minus (front r t) (front r s)) + norm (minus (front o s) (front o t))).
    { replace (minus z zs)
        with (plus (minus (front r t) (front r s)) (minus (front o s) (front o t)));
        [apply norm_plus|].
      unfold z, zs, plus, minus. simpl. f_equal; ring. }
    rewrite (norm_minus_sym (front o s)) in T.
    assert ((v_max S + v_own) * (t - s) <= (v_max S + v_own) * lifetime S)
      by (apply Rmult_le_compat_l; lra). lra. }
  destruct (certificate_holds S v_own lo hi (heading r s) (heading r t) lam c zs z
              HS Hown Hlohi Hcov (Hresp o Ho) Hlam Hdist Hmoved) as [b [Hb Hterms]].
  { assert (lo * lifetime S <= lo * (t - s)) by (apply Rmult_le_compat_neg_l; lra).
    assert (hi * (t - s) <= hi * lifetime S) by (apply Rmult_le_compat_l; lra). lra. }
  apply (Henough b).
  - destruct Hterms as [Hfirst|Hsecond].
    + (* e^-2 of the slack at the sample, at most H ago *)
      eapply Rle_trans; [exact Hfirst|]. apply Rmult_le_compat_l; [lra|].
      pose proof (Hslack s ltac:(lra)) as B. unfold rho, distance in B. fold zs in B.
      apply Rle_trans with (exp (-2) * (exp (- k2 * s) * g)).
      * apply Rmult_le_compat_l; [left; apply exp_pos|exact B].
      * rewrite <- Rmult_assoc, <- exp_plus. apply Rmult_le_compat_r; [exact Hg0|].
        assert (Hexp : -2 + - k2 * s <= - k2 * t).
        { unfold k2. assert (X : L * (t - s) <= L * lifetime S) by (apply Rmult_le_compat_l; lra).
          rewrite HLH in X. lra. }
        destruct (Rle_lt_or_eq_dec _ _ Hexp) as [Hlt|Heq];
          [left; apply exp_increasing; exact Hlt|right; rewrite Heq; reflexivity].
    + (* the slack now *)
      eapply Rle_trans; [exact Hsecond|]. apply Rmult_le_compat_l; [lra|].
      apply (Hslack t). lra.
  - unfold direction, distance, front_velocity. fold z. rewrite Hv, Hw.
    replace (lam * speed c, lam * across c) with (scale lam (speed c, across c)) by reflexivity.
    exact Hb.
Qed.
