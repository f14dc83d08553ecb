(* From the printed loop to its errors, and the max-separable certificate with observer and switching. *)
Require Import Reals List Lra Lia.
From Dobc Require Import Statement.
From Dobc Require Import Comparison.
Import ListNotations.
Open Scope R_scope.

(* ---- The loop in its errors (22) ---- *)

(* What agent i hears in one component, in mode p, when the errors of the agents in that component are e. *)
Definition row (l : loop) (p i : nat) (e : nat -> R) : R :=
  fold_right Rplus 0 (map (fun a =>
    if Nat.eqb (listener a) i then coupling a (e (speaker a) - e i) else 0) (arcs l p)).

(* A - W C of agent i: how its estimation error moves. *)
Definition observer_matrix (l : loop) (i k j : nat) : R :=
  A l i k j - sum (components l) (fun c => W l i k c * C l i c j).

(* The estimation error of agent i. *)
Definition estimation_error (l : loop) (x xi z : nat -> nat -> R -> R) (i k : nat) (t : R) : R :=
  xi i k t - estimate l x z i k t.

(* Every coupling sees the difference of two errors: the goals cancel. *)
Lemma heard_row l mode x i c t :
  heard l mode x i c t = row l (mode t) i (fun j => error l x j c t).
Proof.
  unfold heard, row. f_equal. apply map_ext. intros a.
  destruct (Nat.eqb (listener a) i); [|reflexivity].
  f_equal. unfold error. ring.
Qed.

(* The estimation error obeys eps' = (A - W C) eps: neither the network nor the control enters. *)
Lemma estimation_error_evolves l T mode x xi z :
  closed_loop l T mode x xi z -> forall i k, (i < agents l)%nat -> (k < order l i)%nat ->
  evolves (T := T) (estimation_error l x xi z i k)
    (fun t => sum (order l i) (fun j => observer_matrix l i k j * estimation_error l x xi z i j t)).
Proof.
  intros H i k Hi Hk. destruct (H i Hi) as (Hx & Hxi & Hz).
  assert (Hwx : evolves (T := T) (fun t => sum (components l) (fun c => W l i k c * x i c t))
    (fun t => sum (components l) (fun c =>
       W l i k c * (heard l mode x i c t + control l x z i c t + disturbance l xi i c t)))).
  { apply (evolves_sum (components l) (fun c t => W l i k c * x i c t)
      (fun c t => W l i k c * (heard l mode x i c t + control l x z i c t + disturbance l xi i c t))).
    intros c Hc. apply evolves_scale, Hx, Hc. }
  eapply evolves_eq; [exact (evolves_minus _ _ _ _ (Hxi k Hk) (evolves_plus _ _ _ _ (Hz k Hk) Hwx)) | reflexivity |].
  intros t _. simpl.
  rewrite (sum_ext (components l)
    (fun c => W l i k c * (heard l mode x i c t + control l x z i c t + disturbance l xi i c t))
    (fun c => W l i k c * (heard l mode x i c t + control l x z i c t) + W l i k c * disturbance l xi i c t))
    by (intros; ring).
  rewrite sum_add.
  (* the disturbance seen through W is W C xi *)
  assert (Hd : sum (components l) (fun c => W l i k c * disturbance l xi i c t) =
               sum (order l i) (fun j => sum (components l) (fun c => W l i k c * C l i c j) * xi i j t)).
  { unfold disturbance.
    rewrite (sum_ext _ _ (fun c => sum (order l i) (fun j => W l i k c * C l i c j * xi i j t))).
    - rewrite sum_swap. apply sum_ext. intros j _. apply sum_scale_r.
    - intros c _. rewrite <- sum_scale. apply sum_ext. intros; ring. }
  rewrite Hd.
  rewrite (sum_ext (order l i) (fun j => observer_matrix l i k j * estimation_error l x xi z i j t)
    (fun j => A l i k j * xi i j t
      - ((A l i k j - sum (components l) (fun c => W l i k c * C l i c j)) * estimate l x z i j t
         + sum (components l) (fun c => W l i k c * C l i c j) * xi i j t)))
    by (intros; unfold observer_matrix, estimation_error; ring).
  rewrite sum_sub, sum_add. ring.
Qed.

(* The error obeys e' = h(e) - K e + C eps. *)
Lemma error_evolves l T mode x xi z :
  closed_loop l T mode x xi z -> forall i c, (i < agents l)%nat -> (c < components l)%nat ->
  evolves (T := T) (error l x i c)
    (fun t => row l (mode t) i (fun j => error l x j c t)
      - sum (components l) (fun d => gain l i c d * error l x i d t)
      + sum (order l i) (fun k => C l i c k * estimation_error l x xi z i k t)).
Proof.
  intros H i c Hi Hc. destruct (H i Hi) as (Hx & _).
  eapply evolves_eq;
    [exact (evolves_minus _ _ _ _ (Hx c Hc) (evolves_const (target l c + offset l i c))) | reflexivity |].
  intros t _. simpl. rewrite heard_row. unfold control, disturbance.
  rewrite (sum_ext (order l i) (fun k => C l i c k * estimation_error l x xi z i k t)
    (fun k => C l i c k * xi i k t - C l i c k * estimate l x z i k t))
    by (intros; unfold estimation_error; ring).
  rewrite sum_sub. ring.
Qed.

(* ---- The certificate ---- *)

(* The max-separable certificate: weights v, pinning margins k, inward rate alpha up to box radius rho, the observer's
   Lyapunov matrices P with rate beta, the exchange rate kappa between error and estimation error, and the starts. *)
Record certificate (l : loop) (v k : nat -> R) (alpha rho : R) (P : nat -> nat -> nat -> R)
  (beta kappa size E0 radius off rate : R) : Prop := {
  weights_positive : forall i, (i < agents l)%nat -> 0 < v i;
  box_positive : 0 < rho;
  rate_positive : 0 < rate;
  rate_below_alpha : rate <= alpha;
  rate_below_beta : rate < beta;
  kappa_positive : 0 < kappa;
  estimate_bound_nonneg : 0 <= E0;
  radius_nonneg : 0 <= radius;
  off_nonneg : 0 <= off;
  arcs_inside : forall p a, (p < modes l)%nat -> In a (arcs l p) -> (speaker a < agents l)%nat;
  gains_dominate : forall i c, (i < agents l)%nat -> (c < components l)%nat ->
    k i <= gain l i c c - sum (components l) (fun d => if Nat.eqb d c then 0 else Rabs (gain l i c d));
  upper_rows : forall p i s e, (p < modes l)%nat -> (i < agents l)%nat -> 0 < s -> s <= rho ->
    (forall j, (j < agents l)%nat -> Rabs (e j) <= s * v j) -> e i = s * v i ->
    row l p i e <= (k i - alpha) * s * v i;
  lower_rows : forall p i s e, (p < modes l)%nat -> (i < agents l)%nat -> 0 < s -> s <= rho ->
    (forall j, (j < agents l)%nat -> Rabs (e j) <= s * v j) -> e i = - (s * v i) ->
    - ((k i - alpha) * s * v i) <= row l p i e;
  observer_contracts : forall i a, (i < agents l)%nat ->
    form_slope (order l i) (P i) (observer_matrix l i) a <= - 2 * beta * form (order l i) (P i) a;
  outputs_bounded : forall i c a, (i < agents l)%nat -> (c < components l)%nat ->
    (sum (order l i) (fun h => C l i c h * a h)) ^ 2 <= form (order l i) (P i) a;
  size_bounds_form : forall i a, (i < agents l)%nat ->
    form (order l i) (P i) a <= size * sum (order l i) (fun h => a h ^ 2);
  size_covers_off : size * off ^ 2 <= E0 ^ 2;
  starts_inside : forall i, (i < agents l)%nat -> radius <= v i * (rho - kappa * E0);
  estimates_inside : kappa * E0 < rho;
  exchange : forall i, (i < agents l)%nat -> 1 <= kappa * v i * (beta - rate)
}.

(* |a| <= b from squares. *)
Lemma abs_le_of_squares a b : 0 <= b -> a ^ 2 <= b ^ 2 -> Rabs a <= b.
Proof.
  intros Hb H. rewrite <- (Rabs_right b) by lra. apply Rsqr_le_abs_0. unfold Rsqr. lra.
Qed.

(* What the estimation error injects decays like E0 exp(-beta t). *)
Lemma injection_decays l v k alpha rho P beta kappa size E0 radius off rate :
  certificate l v k alpha rho P beta kappa size E0 radius off rate ->
  forall T mode x xi z, closed_loop l T mode x xi z ->
  forall i, (i < agents l)%nat ->
  sum (order l i) (fun h => (xi i h 0 - estimate l x z i h 0) ^ 2) <= off ^ 2 ->
  forall t c, 0 <= t < T -> (c < components l)%nat ->
    Rabs (sum (order l i) (fun h => C l i c h * estimation_error l x xi z i h t)) <= E0 * exp (- (beta * t)).
Proof.
  intros Cert T mode x xi z H i Hi Hoff t c Ht Hc.
  assert (He := exp_pos (- (beta * t))). assert (HE := estimate_bound_nonneg _ _ _ _ _ _ _ _ _ _ _ _ _ Cert).
  apply abs_le_of_squares; [apply Rmult_le_pos; lra|].
  set (V := fun t => form (order l i) (P i) (fun h => estimation_error l x xi z i h t)).
  assert (Hout : sum (order l i) (fun h => C l i c h * estimation_error l x xi z i h t) ^ 2 <= V t)
    by (apply (outputs_bounded _ _ _ _ _ _ _ _ _ _ _ _ _ Cert i c); assumption).
  assert (Hdec : V t <= V 0 * exp (- (2 * beta * t))).
  { apply (quadratic_decays (T := T) (order l i) (observer_matrix l i)); [| |exact Ht].
    - intros h Hh. exact (estimation_error_evolves l T mode x xi z H i h Hi Hh).
    - intros a. exact (observer_contracts _ _ _ _ _ _ _ _ _ _ _ _ _ Cert i a Hi). }
  assert (Hstart : V 0 <= E0 ^ 2).
  { set (S := sum (order l i) (fun h => estimation_error l x xi z i h 0 ^ 2)).
    assert (HV : V 0 <= size * S) by exact (size_bounds_form _ _ _ _ _ _ _ _ _ _ _ _ _ Cert i _ Hi).
    assert (HS : 0 <= S) by (apply sum_nonneg; intros; apply pow2_ge_0).
    assert (Hcov := size_covers_off _ _ _ _ _ _ _ _ _ _ _ _ _ Cert).
    assert (HE2 := pow2_ge_0 E0).
    change (S <= off ^ 2) in Hoff.
    destruct (Rle_or_lt 0 size).
    - assert (size * S <= size * off ^ 2) by (apply Rmult_le_compat_l; assumption). lra.
    - assert (0 <= - size * S) by (apply Rmult_le_pos; lra). lra. }
  assert (Hexp : exp (- (2 * beta * t)) = exp (- (beta * t)) ^ 2).
  { simpl. rewrite Rmult_1_r, <- exp_plus. f_equal. ring. }
  rewrite Rpow_mult_distr, <- Hexp.
  assert (V 0 * exp (- (2 * beta * t)) <= E0 ^ 2 * exp (- (2 * beta * t))).
  { apply Rmult_le_compat_r; [left; apply exp_pos | exact Hstart]. }
  lra.
Qed.

(* On a face of the box in component c, the pinning pulls inwards at least like k. *)
Lemma pinning_pulls m (gains : nat -> R) (e : nat -> R) c k s :
  (c < m)%nat -> 0 <= s ->
  k <= gains c - sum m (fun d => if Nat.eqb d c then 0 else Rabs (gains d)) ->
  (forall d, (d < m)%nat -> Rabs (e d) <= s) ->
  (e c = s -> k * s <= sum m (fun d => gains d * e d)) /\
  (e c = - s -> sum m (fun d => gains d * e d) <= - (k * s)).
Proof.
  intros Hc Hs Hk He.
  rewrite (sum_split m (fun d => gains d * e d) c Hc).
  set (rest := sum m (fun d => if Nat.eqb d c then 0 else gains d * e d)).
  assert (Hrest : Rabs rest <= sum m (fun d => if Nat.eqb d c then 0 else Rabs (gains d)) * s).
  { eapply Rle_trans; [apply sum_abs|]. rewrite <- sum_scale_r. apply sum_le. intros d Hd.
    destruct (Nat.eqb d c); [rewrite Rabs_R0; lra|].
    rewrite Rabs_mult. apply Rmult_le_compat_l; [apply Rabs_pos | apply He, Hd]. }
  assert (Hlow := Rle_abs (- rest)). rewrite Rabs_Ropp in Hlow. assert (Hup := Rle_abs rest).
  assert (Hks : 0 <= (gains c - sum m (fun d => if Nat.eqb d c then 0 else Rabs (gains d)) - k) * s)
    by (apply Rmult_le_pos; lra).
  split; intros ->; lra.
Qed.

(* A face that shrinks more slowly than the certified rate is never overtaken. *)
Lemma face_slower v k alpha beta kappa rate slow M inj E :
  0 < v -> 0 < M -> 0 <= E -> 0 < slow < rate -> rate <= alpha -> 0 < kappa ->
  1 <= kappa * v * (beta - rate) -> inj <= E ->
  (k - alpha) * M * v - k * (M * v) + inj < v * (- slow * M + kappa * (beta - slow) * E).
Proof.
  intros Hv HM HE Hslow Hrate Hkappa Hex Hinj.
  assert (Hvm : 0 < v * M) by (apply Rmult_lt_0_compat; assumption).
  assert (Hkv : 0 < kappa * v) by (apply Rmult_lt_0_compat; assumption).
  assert (H1 : 0 < (alpha - slow) * (v * M)) by (apply Rmult_lt_0_compat; lra).
  assert (H2 : 0 <= (kappa * v) * (rate - slow)) by (apply Rmult_le_pos; lra).
  assert (H3 : 0 <= (kappa * v * (beta - slow) - 1) * E) by (apply Rmult_le_pos; lra).
  lra.
Qed.

(* The bound for every rate below the certified one. *)
Lemma certified_below l v k alpha rho P beta kappa size E0 radius off rate :
  certificate l v k alpha rho P beta kappa size E0 radius off rate ->
  forall slow, 0 < slow < rate -> converges l radius off (fun i => rho * v i) slow.
Proof.
  intros Cert slow Hslow T mode x xi z Hmode H Hstart Hoff.
  pose proof Cert as [Hv Hrho Hrate Halpha Hbeta Hkappa HE Hrad Hoffpos _ Hgain Hup Hlow _ _ _ _ Hin Hest Hex].
  assert (Hinj : forall i c t, (i < agents l)%nat -> (c < components l)%nat -> 0 <= t < T ->
     Rabs (sum (order l i) (fun h => C l i c h * estimation_error l x xi z i h t)) <= E0 * exp (- (beta * t))).
  { intros i c t Hi Hc Ht.
    exact (injection_decays _ _ _ _ _ _ _ _ _ _ _ _ _ Cert T mode x xi z H i Hi (Hoff i Hi) t c Ht Hc). }
  set (M := fun t => rho * exp (- (slow * t)) - kappa * E0 * exp (- (beta * t))).
  set (M' := fun t => rho * (- slow * exp (- (slow * t))) - kappa * E0 * (- beta * exp (- (beta * t)))).
  assert (HM : evolves (T := T) M M') by (apply evolves_minus; apply evolves_scale, evolves_exp_decay).
  assert (HM' : forall t, M' t = - slow * M t + kappa * (beta - slow) * (E0 * exp (- (beta * t)))).
  { intros t. unfold M, M'. ring. }
  assert (HkE : 0 <= kappa * E0) by (apply Rmult_le_pos; lra).
  assert (HMpos : forall t, 0 <= t < T -> 0 < M t <= rho * exp (- (slow * t))).
  { intros t Ht. unfold M.
    assert (Hes := exp_pos (- (slow * t))). assert (Heb := exp_pos (- (beta * t))).
    assert (Hle : exp (- (beta * t)) <= exp (- (slow * t))).
    { apply exp_le, Ropp_le_contravar. apply Rmult_le_compat_r; lra. }
    assert (0 < (rho - kappa * E0) * exp (- (slow * t))) by (apply Rmult_lt_0_compat; lra).
    assert (kappa * E0 * exp (- (beta * t)) <= kappa * E0 * exp (- (slow * t)))
      by (apply Rmult_le_compat_l; assumption).
    assert (0 <= kappa * E0 * exp (- (beta * t))) by (apply Rmult_le_pos; lra).
    lra. }
  assert (HMrho : forall t, 0 <= t < T -> M t <= rho).
  { intros t Ht. destruct (HMpos t Ht) as (_ & Hm).
    assert (exp (- (slow * t)) <= exp 0).
    { apply exp_le. assert (0 <= slow * t) by (apply Rmult_le_pos; lra). lra. }
    rewrite exp_0 in *.
    assert (rho * exp (- (slow * t)) <= rho * 1) by (apply Rmult_le_compat_l; lra). lra. }
  assert (Hbox : forall t, 0 <= t < T -> forall i c, (i < agents l)%nat -> (c < components l)%nat ->
     Rabs (error l x i c t) <= M t * v i).
  { refine (never_leaves_agents (agents l) (components l) (error l x)
      (fun i c t => row l (mode t) i (fun j => error l x j c t)
         - sum (components l) (fun d => gain l i c d * error l x i d t)
         + sum (order l i) (fun h => C l i c h * estimation_error l x xi z i h t))
      (fun i c t => M t * v i) (fun i c t => M' t * v i) _ _ _ _).
    - intros i c Hi Hc. exact (error_evolves l T mode x xi z H i c Hi Hc).
    - intros i c _ _. eapply evolves_eq; [exact (evolves_scale (v i) _ _ HM) | |]; intros; simpl; ring.
    - intros i c Hi Hc. eapply Rle_trans; [apply (Hstart i c Hi Hc)|].
      unfold M. rewrite !Rmult_0_r, Ropp_0, exp_0, !Rmult_1_r, Rmult_comm. exact (Hin i Hi).
    - intros t Ht Hall i c Hi Hc.
      destruct (HMpos t Ht) as (Hpos & _). assert (Hle := HMrho t Ht).
      specialize (Hv i Hi). specialize (Hex i Hi).
      assert (Hvm : 0 < M t * v i) by (apply Rmult_lt_0_compat; assumption).
      destruct (pinning_pulls (components l) (gain l i c) (fun d => error l x i d t) c (k i) (M t * v i))
        as (Hpu & Hpl); [exact Hc | lra | exact (Hgain i c Hi Hc) | intros d Hd; apply Hall; assumption |].
      assert (HEt : 0 <= E0 * exp (- (beta * t))) by (apply Rmult_le_pos; [exact HE | left; apply exp_pos]).
      specialize (Hinj i c t Hi Hc Ht).
      assert (Hl := Rle_abs (- sum (order l i) (fun h => C l i c h * estimation_error l x xi z i h t))).
      rewrite Rabs_Ropp in Hl.
      assert (Hu := Rle_abs (sum (order l i) (fun h => C l i c h * estimation_error l x xi z i h t))).
      assert (Hcol : forall j, (j < agents l)%nat -> Rabs (error l x j c t) <= M t * v j)
        by (intros j Hj; apply Hall; assumption).
      rewrite HM'. split; intros Hface.
      + assert (Hr := Hup (mode t) i (M t) (fun j => error l x j c t) (Hmode t Ht) Hi Hpos Hle Hcol Hface).
        specialize (Hpu Hface).
        assert (Hf := face_slower (v i) (k i) alpha beta kappa rate slow (M t) _ _
          Hv Hpos HEt Hslow Halpha Hkappa Hex (Rle_trans _ _ _ Hu Hinj)). lra.
      + assert (Hr := Hlow (mode t) i (M t) (fun j => error l x j c t) (Hmode t Ht) Hi Hpos Hle Hcol Hface).
        specialize (Hpl Hface).
        assert (Hf := face_slower (v i) (k i) alpha beta kappa rate slow (M t) _ _
          Hv Hpos HEt Hslow Halpha Hkappa Hex (Rle_trans _ _ _ Hl Hinj)). lra. }
  intros t i c Ht Hi Hc.
  eapply Rle_trans; [apply (Hbox t Ht i c Hi Hc)|].
  destruct (HMpos t Ht) as (_ & Hm). specialize (Hv i Hi).
  apply Rle_trans with (rho * exp (- (slow * t)) * v i); [apply Rmult_le_compat_r; lra | lra].
Qed.

(* A bound that holds for every slower rate holds for the rate itself. *)
Lemma converges_at_limit_rate l radius off bound rate :
  0 < rate -> (forall slow, 0 < slow < rate -> converges l radius off bound slow) ->
  converges l radius off bound rate.
Proof.
  intros Hrate H T mode x xi z Hmode Hloop Hstart Hoff t i c Ht Hi Hc.
  set (e := Rabs (error l x i c t)).
  apply (no_slack _ _ (e * t * rate)). intros eps Heps.
  (* slow = (1 - eps) rate, or half of it when eps = 1 *)
  set (gap := eps / 2 * rate).
  assert (Hgap : 0 < gap < rate /\ gap <= eps * rate).
  { assert (0 < eps * rate) by (apply Rmult_lt_0_compat; lra).
    assert (0 <= (1 - eps) * rate) by (apply Rmult_le_pos; lra). unfold gap; lra. }
  assert (Hs := H (rate - gap) ltac:(lra) T mode x xi z Hmode Hloop Hstart Hoff t i c Ht Hi Hc).
  fold e in Hs. assert (He : 0 <= e) by apply Rabs_pos.
  assert (Hgt : 0 <= gap * t) by (apply Rmult_le_pos; lra).
  assert (Htan := exp_tangent _ Hgt).
  replace (- (rate * t)) with (- ((rate - gap) * t) + - (gap * t)) by ring. rewrite exp_plus.
  assert (H1 : e * exp (- (gap * t)) <= bound i * exp (- ((rate - gap) * t)) * exp (- (gap * t)))
    by (apply Rmult_le_compat_r; [left; apply exp_pos | exact Hs]).
  assert (H2 : e * (1 - gap * t) <= e * exp (- (gap * t))) by (apply Rmult_le_compat_l; assumption).
  assert (H3 : 0 <= (eps * rate - gap) * (e * t)).
  { apply Rmult_le_pos; [lra | apply Rmult_le_pos; lra]. }
  lra.
Qed.

(* The main theorem: with a certificate, every motion of the printed loop, under every switching signal, that starts
   in the box with estimates off by at most [off], stays below rho v_i exp(-rate t). *)
Theorem certified : forall l v k alpha rho P beta kappa size E0 radius off rate,
  certificate l v k alpha rho P beta kappa size E0 radius off rate ->
  converges l radius off (fun i => rho * v i) rate.
Proof.
  intros l v k alpha rho P beta kappa size E0 radius off rate Cert.
  apply converges_at_limit_rate; [exact (rate_positive _ _ _ _ _ _ _ _ _ _ _ _ _ Cert)|].
  exact (certified_below _ _ _ _ _ _ _ _ _ _ _ _ _ Cert).
Qed.

(* ---- Couplings without a limit: no start is excluded ---- *)

(* Homogeneous couplings (h(s y) = s h(y) for s > 0): a row scales with its argument. *)
Lemma row_scales l p i s e :
  (forall a y, In a (arcs l p) -> coupling a (s * y) = s * coupling a y) ->
  row l p i (fun j => s * e j) = s * row l p i e.
Proof.
  unfold row. generalize (arcs l p). induction l0 as [|a arcs IH]; simpl; intros H; [ring|].
  rewrite IH by (intros; apply H; right; assumption).
  destruct (Nat.eqb (listener a) i); [|ring].
  replace (s * e (speaker a) - s * e i) with (s * (e (speaker a) - e i)) by ring.
  rewrite (H a) by (left; reflexivity). ring.
Qed.

(* One certificate of a loop with homogeneous couplings, scaled by any factor. *)
Lemma certificate_scales : forall l v k alpha rho P beta kappa size E0 radius off rate,
  certificate l v k alpha rho P beta kappa size E0 radius off rate ->
  (forall p a s y, (p < modes l)%nat -> In a (arcs l p) -> 0 < s -> coupling a (s * y) = s * coupling a y) ->
  forall factor, 0 < factor ->
  certificate l v k alpha (factor * rho) P beta kappa size (factor * E0) (factor * radius) (factor * off) rate.
Proof.
  intros l v k alpha rho P beta kappa size E0 radius off rate Cert Hhom factor Hf.
  destruct Cert as [Hv Hrho Hrate Halpha Hbeta Hkappa HE Hrad Hoffpos Harcs Hgain Hup Hlow Hobs Hout Hsize Hcov Hin Hest Hex].
  assert (Hinv : 0 < / factor) by (apply Rinv_0_lt_compat, Hf).
  assert (Hunit : / factor * factor = 1) by (field; lra).
  assert (Hrow : forall p i e, (p < modes l)%nat -> row l p i e = factor * row l p i (fun j => / factor * e j)).
  { intros p i e Hp. rewrite row_scales by (intros; apply (Hhom p); assumption). field. lra. }
  assert (Hdown : forall s, s <= factor * rho -> / factor * s <= rho).
  { intros s Hs. replace rho with (/ factor * (factor * rho)) by (field; lra).
    apply Rmult_le_compat_l; lra. }
  assert (Hsmall : forall s e, (forall j, (j < agents l)%nat -> Rabs (e j) <= s * v j) ->
     forall j, (j < agents l)%nat -> Rabs (/ factor * e j) <= / factor * s * v j).
  { intros s e He j Hj. rewrite Rabs_mult, (Rabs_right (/ factor)), Rmult_assoc by lra.
    apply Rmult_le_compat_l; [lra | apply He, Hj]. }
  constructor; try assumption.
  - apply Rmult_lt_0_compat; assumption.
  - apply Rmult_le_pos; lra.
  - apply Rmult_le_pos; lra.
  - apply Rmult_le_pos; lra.
  - intros p i s e Hp Hi Hs Hle He Hface. rewrite Hrow by exact Hp.
    assert (H : row l p i (fun j => / factor * e j) <= (k i - alpha) * (/ factor * s) * v i).
    { apply Hup; [exact Hp | exact Hi | apply Rmult_lt_0_compat; lra | apply Hdown, Hle
        | apply Hsmall, He | rewrite Hface; ring]. }
    replace ((k i - alpha) * s * v i) with (factor * ((k i - alpha) * (/ factor * s) * v i)) by (field; lra).
    apply Rmult_le_compat_l; lra.
  - intros p i s e Hp Hi Hs Hle He Hface. rewrite Hrow by exact Hp.
    assert (H : - ((k i - alpha) * (/ factor * s) * v i) <= row l p i (fun j => / factor * e j)).
    { apply Hlow; [exact Hp | exact Hi | apply Rmult_lt_0_compat; lra | apply Hdown, Hle
        | apply Hsmall, He | rewrite Hface; ring]. }
    replace (- ((k i - alpha) * s * v i)) with (factor * - ((k i - alpha) * (/ factor * s) * v i)) by (field; lra).
    apply Rmult_le_compat_l; lra.
  - rewrite !Rpow_mult_distr.
    replace (size * (factor ^ 2 * off ^ 2)) with (factor ^ 2 * (size * off ^ 2)) by ring.
    apply Rmult_le_compat_l; [apply pow2_ge_0 | exact Hcov].
  - intros i Hi.
    replace (v i * (factor * rho - kappa * (factor * E0))) with (factor * (v i * (rho - kappa * E0))) by ring.
    apply Rmult_le_compat_l; [lra | apply Hin, Hi].
  - replace (kappa * (factor * E0)) with (factor * (kappa * E0)) by ring.
    apply Rmult_lt_compat_l; assumption.
Qed.

(* So one certificate covers every start: radius and [off] may be scaled up together, and the bound with them. *)
Corollary certified_scales : forall l v k alpha rho P beta kappa size E0 radius off rate,
  certificate l v k alpha rho P beta kappa size E0 radius off rate ->
  (forall p a s y, (p < modes l)%nat -> In a (arcs l p) -> 0 < s -> coupling a (s * y) = s * coupling a y) ->
  forall factor, 0 < factor ->
  converges l (factor * radius) (factor * off) (fun i => factor * rho * v i) rate.
Proof.
  intros l v k alpha rho P beta kappa size E0 radius off rate Cert Hhom factor Hf.
  exact (certified _ _ _ _ _ _ _ _ _ _ _ _ _ (certificate_scales _ _ _ _ _ _ _ _ _ _ _ _ _ Cert Hhom factor Hf)).
Qed.

(* ---- Starts given as a box of states ---- *)

(* As [converges], for starts x_i,c(0) in [lo, hi]. *)
Definition converges_from_states (l : loop) (lo hi off : R) (bound : nat -> R) (rate : R) : Prop :=
  forall T mode x xi z,
    (forall t, 0 <= t < T -> (mode t < modes l)%nat) ->
    closed_loop l T mode x xi z ->
    (forall i c, (i < agents l)%nat -> (c < components l)%nat -> lo <= x i c 0 <= hi) ->
    (forall i, (i < agents l)%nat -> sum (order l i) (fun k => (xi i k 0 - estimate l x z i k 0) ^ 2) <= off ^ 2) ->
  forall t i c, 0 <= t < T -> (i < agents l)%nat -> (c < components l)%nat ->
    Rabs (error l x i c t) <= bound i * exp (- (rate * t)).

(* A radius that reaches both ends of the box from every goal covers the box. *)
Lemma from_states l radius off bound rate lo hi :
  (forall i c, (i < agents l)%nat -> (c < components l)%nat ->
     Rabs (lo - (target l c + offset l i c)) <= radius /\ Rabs (hi - (target l c + offset l i c)) <= radius) ->
  converges l radius off bound rate -> converges_from_states l lo hi off bound rate.
Proof.
  intros Hends H T mode x xi z Hmode Hloop Hbox. apply (H T mode x xi z Hmode Hloop).
  intros i c Hi Hc. destruct (Hends i c Hi Hc) as (Hl & Hh). specialize (Hbox i c Hi Hc).
  assert (H1 := Rle_abs (- (lo - (target l c + offset l i c)))). rewrite Rabs_Ropp in H1.
  assert (H2 := Rle_abs (hi - (target l c + offset l i c))).
  apply Rabs_le. unfold error. lra.
Qed.

Corollary certified_from_states : forall l v k alpha rho P beta kappa size E0 radius off rate lo hi,
  certificate l v k alpha rho P beta kappa size E0 radius off rate ->
  (forall i c, (i < agents l)%nat -> (c < components l)%nat ->
     Rabs (lo - (target l c + offset l i c)) <= radius /\ Rabs (hi - (target l c + offset l i c)) <= radius) ->
  converges_from_states l lo hi off (fun i => rho * v i) rate.
Proof.
  intros l v k alpha rho P beta kappa size E0 radius off rate lo hi Cert Hends.
  apply (from_states l radius); [exact Hends|].
  exact (certified _ _ _ _ _ _ _ _ _ _ _ _ _ Cert).
Qed.
