(*** DEFINITIONS ***)
Require Import QArith List Arith Bool Lia Reals Qreals Lqa Lra.
Import ListNotations.
Open Scope Q_scope.

(* f 0 + ... + f (k - 1). *)
Fixpoint sum (k : nat) (f : nat -> Q) : Q :=
  match k with O => 0 | S i => sum i f + f i end.

(* x' M x.  A matrix or vector is a function of its indices, which count from 0;
   only the entries with indices below k enter. *)
Definition form (k : nat) (M : nat -> nat -> Q) (x : nat -> Q) : Q :=
  sum k (fun i => sum k (fun j => x i * M i j * x j)).

Definition nonzero (k : nat) (x : nat -> Q) : Prop :=
  exists i, (i < k)%nat /\ ~ x i == 0.

Definition positive_definite (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero k x -> 0 < form k M x.

Definition negative_definite (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero k x -> form k M x < 0.

(* The same for real vectors; Q2R embeds the rationals into the reals. *)
Fixpoint sum_R (k : nat) (f : nat -> R) : R :=
  match k with O => 0%R | S i => (sum_R i f + f i)%R end.

Definition form_R (k : nat) (M : nat -> nat -> Q) (x : nat -> R) : R :=
  sum_R k (fun i => sum_R k (fun j => (x i * Q2R (M i j) * x j)%R)).

Definition nonzero_R (k : nat) (x : nat -> R) : Prop :=
  exists i, (i < k)%nat /\ x i <> 0%R.

Definition positive_definite_R (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero_R k x -> (0 < form_R k M x)%R.

Definition negative_definite_R (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero_R k x -> (form_R k M x < 0)%R.

(* A matrix from its rows. *)
Definition matrix (rows : list (list Q)) (i j : nat) : Q := nth j (nth i rows []) 0.

Definition delta (i j : nat) : Q := if Nat.eqb i j then 1 else 0.

(* Agent `listener` hears agent `speaker`; `slope` is h'(0) times the weight of the arc, m x m. *)
Record arc := Arc { listener : nat; speaker : nat; slope : nat -> nat -> Q }.

(* Agent `pinned` feels -gain (x_i - xbar). *)
Record pin := Pin { pinned : nat; gain : nat -> nat -> Q }.

Definition total {T : Type} (f : T -> Q) (l : list T) : Q := fold_right (fun a s => f a + s) 0 l.

(*** NETWORK ***)
(* J = dh/de at the consensus: an arc puts its slope at block (listener, speaker) and minus its
   slope at block (listener, listener).  Row i belongs to component (i mod m) of agent (i / m). *)
Definition J (arcs : list arc) (i j : nat) : Q :=
  let a := (i / m)%nat in let c := (i mod m)%nat in
  let b := (j / m)%nat in let d := (j mod m)%nat in
  total (fun each =>
    if Nat.eqb a (listener each)
    then slope each c d * (delta b (speaker each) - delta b (listener each))
    else 0) arcs.

(* K = diag(k_1, ..., k_n), the pinning gains. *)
Definition K (i j : nat) : Q :=
  let a := (i / m)%nat in let c := (i mod m)%nat in
  let b := (j / m)%nat in let d := (j mod m)%nat in
  if Nat.eqb a b then total (fun each => if Nat.eqb a (pinned each) then gain each c d else 0) pins else 0.

(* Lambda = J + J' - (K + K'). *)
Definition Lambda (arcs : list arc) (i j : nat) : Q := J arcs i j + J arcs j i - (K i j + K j i).

(*** OBSERVER ***)
(* Omega0 = P A + A' P - C' Q' - Q C, with Q = P W written Qm (Coq calls the rationals Q). *)
Definition Omega0 (k l : nat) : Q :=
  sum q (fun j => P k j * A j l) + sum q (fun j => A j k * P j l)
  - sum m (fun c => C c k * Qm l c) - sum m (fun c => Qm k c * C c l).

(* I (x) C. *)
Definition IC (i t : nat) : Q :=
  if Nat.eqb (i / m) (t / q) then C (i mod m) (t mod q) else 0.

(* I (x) B for a block B of size q. *)
Definition blocks (B : nat -> nat -> Q) (s t : nat) : Q :=
  if Nat.eqb (s / q) (t / q) then B (s mod q) (t mod q) else 0.

(* Psi = [[Lambda, I (x) C], [(I (x) C)', I (x) Omega0]], equation (18) (for several modes (28)). *)
Definition offset : nat := (n * m)%nat.
Definition size : nat := (n * m + n * q)%nat.

Definition Psi (arcs : list arc) (i j : nat) : Q :=
  if Nat.ltb i offset
  then if Nat.ltb j offset then Lambda arcs i j else IC i (j - offset)
  else if Nat.ltb j offset then IC j (i - offset) else blocks Omega0 (i - offset) (j - offset).

(* V = e'e + sum over i of eps_i' P eps_i has the matrix diag(I, I (x) P). *)
Definition V (i j : nat) : Q :=
  if Nat.ltb i offset then delta i j
  else if Nat.ltb j offset then 0 else blocks P (i - offset) (j - offset).

(* The closed loop (22) at the consensus, z' = F z with z = (e, eps):
   e' = (J - K) e + (I (x) C) eps,  eps' = (I (x) (A - W C)) eps. *)
Definition estimation (k l : nat) : Q := A k l - sum m (fun c => W k c * C c l).

Definition F (arcs : list arc) (i j : nat) : Q :=
  if Nat.ltb i offset
  then if Nat.ltb j offset then J arcs i j - K i j else IC i (j - offset)
  else if Nat.ltb j offset then 0 else blocks estimation (i - offset) (j - offset).

(*** ALONE ***)
(* Without a disturbance the condition is that of Lemma 1, Lambda < 0.  It is called Psi here. *)
Definition size : nat := (n * m)%nat.

Definition Psi (arcs : list arc) (i j : nat) : Q := Lambda arcs i j.

(* V = e'e, and the closed loop at the consensus, z' = F z with z = e: e' = (J - K) e. *)
Definition V (i j : nat) : Q := delta i j.

Definition F (arcs : list arc) (i j : nat) : Q := J arcs i j - K i j.

(*** DERIVATIVE ***)
(* F' V + V F: along z' = F z the derivative of z' V z is z' (F' V + V F) z. *)
Definition derivative (arcs : list arc) (i j : nat) : Q :=
  sum size (fun k => F arcs k i * V k j + V i k * F arcs k j).

(*** RATE ***)
(* Psi + 2 rate V: where it is negative definite, V decreases faster than exp(-2 rate t). *)
Definition Psi_rate (arcs : list arc) (i j : nat) : Q := Psi arcs i j + 2 * rate * V i j.

(*** CHECKER ***)
(* d (x_pivot + sum of factor x_place)^2: an entry d of D and a column of L. *)
Record term := Term { place : nat; factor : Q }.
Record square := Square { weight : Q; pivot : nat; others : list term }.

Fixpoint find (l : list term) (i : nat) : Q :=
  match l with
  | [] => 0
  | t :: rest => if Nat.eqb i (place t) then factor t else find rest i
  end.

(* Entry i of the column: 1 at the pivot. *)
Definition column (s : square) (i : nat) : Q := if Nat.eqb i (pivot s) then 1 else find (others s) i.

(* Entry (i, j) of L D L'. *)
Fixpoint product (l : list square) (i j : nat) : Q :=
  match l with
  | [] => 0
  | s :: rest =>
      let a := column s i in
      let b := column s j in
      if Qeq_bool a 0 || Qeq_bool b 0 then product rest i j
      else Qred (weight s * (a * b) + product rest i j)
  end.

Definition member (i : nat) (l : list nat) : bool := existsb (Nat.eqb i) l.
Definition all_below (k : nat) (p : nat -> bool) : bool := forallb p (seq 0 k).
Definition same (k : nat) (M N : nat -> nat -> Q) : bool :=
  all_below k (fun i => all_below k (fun j => Qeq_bool (M i j) (N i j))).

(* Every d is positive, and a column has entries at its own pivot and at later pivots only. *)
Fixpoint triangular (k : nat) (l : list square) : bool :=
  match l with
  | [] => true
  | s :: rest =>
      Nat.ltb (pivot s) k && negb (Qle_bool (weight s) 0)
      && all_below k (fun i => Nat.eqb i (pivot s) || member i (map pivot rest) || Qeq_bool (column s i) 0)
      && triangular k rest
  end.

(* D > 0, L unit lower triangular with a pivot in every row, and M = L D L' entry by entry. *)
Definition check (k : nat) (M : nat -> nat -> Q) (l : list square) : bool :=
  triangular k l && all_below k (fun i => member i (map pivot l)) && same k M (product l).

Lemma member_in : forall i l, member i l = true -> In i l.
Proof.
  intros i l H. apply existsb_exists in H. destruct H as [k [Hk E]].
  apply Nat.eqb_eq in E. subst. exact Hk.
Qed.

Lemma all_below_spec : forall k p, all_below k p = true -> forall i, (i < k)%nat -> p i = true.
Proof.
  intros k p H i Hi. unfold all_below in H. rewrite forallb_forall in H.
  apply H. apply in_seq. lia.
Qed.

Lemma same_spec : forall k M N, same k M N = true ->
  forall i j, (i < k)%nat -> (j < k)%nat -> M i j == N i j.
Proof.
  intros k M N H i j Hi Hj. apply Qeq_bool_iff.
  exact (all_below_spec k _ (all_below_spec k _ H i Hi) j Hj).
Qed.

Lemma triangular_step : forall k s rest, triangular k (s :: rest) = true ->
  (pivot s < k)%nat /\ 0 < weight s /\
  (forall i, (i < k)%nat -> i = pivot s \/ In i (map pivot rest) \/ column s i == 0) /\
  triangular k rest = true.
Proof.
  intros k s rest H. cbn [triangular] in H.
  apply andb_prop in H. destruct H as [H T]. apply andb_prop in H. destruct H as [H Z].
  apply andb_prop in H. destruct H as [L D].
  split; [apply Nat.ltb_lt; exact L|]. split.
  { apply Qnot_le_lt. intros N. apply Qle_bool_iff in N. rewrite N in D. discriminate D. }
  split; [|exact T]. intros i Hi. generalize (all_below_spec k _ Z i Hi). intros G. cbn beta in G.
  apply orb_prop in G. destruct G as [G|G].
  - apply orb_prop in G. destruct G as [G|G].
    + left. apply Nat.eqb_eq. exact G.
    + right. left. apply member_in. exact G.
  - right. right. apply Qeq_bool_iff. exact G.
Qed.

Lemma product_step : forall s rest i j,
  product (s :: rest) i j == weight s * (column s i * column s j) + product rest i j.
Proof.
  intros. cbn [product]. destruct (Qeq_bool (column s i) 0) eqn:E; cbn [orb].
  - apply Qeq_bool_iff in E. rewrite E. ring.
  - destruct (Qeq_bool (column s j) 0) eqn:G.
    + apply Qeq_bool_iff in G. rewrite G. ring.
    + rewrite Qred_correct. reflexivity.
Qed.

(*** OVER_Q ***)
Import Lqa.

Lemma sum_equal : forall k f g, (forall i, (i < k)%nat -> f i == g i) -> sum k f == sum k g.
Proof.
  induction k as [|k IH]; intros f g H; simpl; [reflexivity|].
  rewrite (IH f g) by (intros; apply H; lia). rewrite (H k) by lia. reflexivity.
Qed.

Lemma sum_add : forall k f g, sum k (fun i => f i + g i) == sum k f + sum k g.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_scale : forall k a f, sum k (fun i => a * f i) == a * sum k f.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_zero : forall k f, (forall i, (i < k)%nat -> f i == 0) -> sum k f == 0.
Proof.
  induction k as [|k IH]; intros f H; simpl; [reflexivity|].
  rewrite IH by (intros; apply H; lia). rewrite (H k) by lia. reflexivity.
Qed.

Lemma sum_single : forall k f p, (p < k)%nat ->
  (forall i, (i < k)%nat -> i <> p -> f i == 0) -> sum k f == f p.
Proof.
  induction k as [|k IH]; intros f p Hp H; [lia|]. simpl.
  destruct (Nat.eq_dec p k) as [E|E].
  - subst. rewrite sum_zero by (intros; apply H; lia). ring.
  - rewrite (IH f p) by (try lia; intros; apply H; lia). rewrite (H k) by lia. ring.
Qed.

Lemma form_equal : forall k M N x,
  (forall i j, (i < k)%nat -> (j < k)%nat -> M i j == N i j) -> form k M x == form k N x.
Proof.
  intros k M N x H. unfold form. apply sum_equal. intros i Hi. apply sum_equal. intros j Hj.
  rewrite (H i j Hi Hj). reflexivity.
Qed.

Lemma form_negated : forall k M x, form k (fun i j => - M i j) x == - form k M x.
Proof.
  intros k M x. unfold form.
  rewrite (sum_equal k _ (fun i => (-(1)) * sum k (fun j => x i * M i j * x j))).
  - rewrite sum_scale. ring.
  - intros i _. rewrite <- sum_scale. apply sum_equal. intros. ring.
Qed.

(* The linear form of a square, and the sum of the squares. *)
Definition value (k : nat) (x : nat -> Q) (s : square) : Q := sum k (fun i => column s i * x i).

Definition squares (k : nat) (l : list square) (x : nat -> Q) : Q :=
  fold_right (fun s v => weight s * (value k x s * value k x s) + v) 0 l.

Lemma form_product : forall k l x, form k (product l) x == squares k l x.
Proof.
  intros k l x. induction l as [|s rest IH].
  - unfold form. apply sum_zero. intros. apply sum_zero. intros. cbn [product]. ring.
  - rewrite (form_equal k _ (fun i j => weight s * (column s i * column s j) + product rest i j))
      by (intros; apply product_step).
    unfold squares. cbn [fold_right]. fold (squares k rest x). rewrite <- IH. unfold form.
    rewrite (sum_equal k _ (fun i => weight s * value k x s * (column s i * x i)
      + sum k (fun j => x i * product rest i j * x j))).
    + rewrite sum_add, sum_scale. unfold value. ring.
    + intros i _. rewrite (sum_equal k _ (fun j => (weight s * (column s i * x i)) * (column s j * x j)
        + x i * product rest i j * x j)) by (intros; ring).
      rewrite sum_add, sum_scale. unfold value. ring.
Qed.

Lemma square_positive : forall a, ~ a == 0 -> 0 < a * a.
Proof. intros a N. destruct (Q_dec a 0) as [[L|L]|E]; [nra | nra | contradiction]. Qed.

Lemma squares_nonnegative : forall k l x, triangular k l = true -> 0 <= squares k l x.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H; [apply Qle_refl|].
  destruct (triangular_step k s rest H) as [_ [D [_ T]]]. specialize (IH T).
  unfold squares in *. cbn [fold_right]. nra.
Qed.

(* If the sum of the squares is 0, every x_i is 0: from the last column back to the first. *)
Lemma squares_vanish : forall k l x, triangular k l = true -> squares k l x <= 0 ->
  forall i, In i (map pivot l) -> x i == 0.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H Z i Hi; [destruct Hi|].
  destruct (triangular_step k s rest H) as [Hp [D [Later T]]].
  pose proof (squares_nonnegative k rest x T) as N.
  assert (Zr : squares k rest x <= 0) by (unfold squares in *; cbn [fold_right] in Z; nra).
  assert (Zs : value k x s == 0).
  { assert (S : weight s * (value k x s * value k x s) <= 0)
      by (unfold squares in *; cbn [fold_right] in Z; lra).
    destruct (Qeq_dec (value k x s) 0) as [Y|Y]; [exact Y|].
    pose proof (square_positive _ Y) as Y2. nra. }
  specialize (IH T Zr). cbn [map] in Hi.
  assert (X : x (pivot s) == 0).
  { unfold value in Zs. rewrite (sum_single k _ (pivot s) Hp) in Zs.
    - unfold column in Zs. rewrite Nat.eqb_refl in Zs. rewrite <- Zs. ring.
    - intros j Hj Other. destruct (Later j Hj) as [E|[E|E]]; [contradiction| |].
      + rewrite (IH j E). ring.
      + rewrite E. ring. }
  destruct Hi as [E|E]; [rewrite <- E; exact X | exact (IH i E)].
Qed.

Theorem check_positive : forall k M l, check k M l = true -> positive_definite k M.
Proof.
  intros k M l H x [i [Hi N]]. unfold check in H.
  apply andb_prop in H. destruct H as [H E]. apply andb_prop in H. destruct H as [T Pivots].
  rewrite (form_equal k M (product l) x (same_spec k M (product l) E)).
  rewrite form_product. apply Qnot_le_lt. intros Z. apply N.
  apply (squares_vanish k l x T Z). apply member_in. exact (all_below_spec k _ Pivots i Hi).
Qed.

Theorem check_negative : forall k M l, check k (fun i j => - M i j) l = true -> negative_definite k M.
Proof.
  intros k M l H x N. pose proof (check_positive k _ l H x N) as G. rewrite form_negated in G. lra.
Qed.

(* A matrix computed once and looked up from then on, and a sum that stays in lowest terms. *)
Definition table (k : nat) (M : nat -> nat -> Q) : list (list Q) :=
  map (fun i => map (fun j => Qred (M i j)) (seq 0 k)) (seq 0 k).

Fixpoint short_sum (k : nat) (f : nat -> Q) : Q :=
  match k with
  | O => 0
  | S i => let a := f i in if Qeq_bool a 0 then short_sum i f else Qred (short_sum i f + a)
  end.

(* Whether S is F' V + V F. *)
Definition check_derivative (k : nat) (F V S : nat -> nat -> Q) : bool :=
  let f := matrix (table k F) in
  let v := matrix (table k V) in
  same k S (fun i j => short_sum k (fun h => f h i * v h j + v i h * f h j)).

Lemma nth_table : forall (T : Type) (g : nat -> T) (d : T) k start i,
  (i < k)%nat -> nth i (map g (seq start k)) d = g (start + i)%nat.
Proof.
  intros T g d. induction k as [|k IH]; intros start i H; [lia|]. destruct i as [|i]; simpl.
  - f_equal. lia.
  - rewrite IH by lia. f_equal. lia.
Qed.

Lemma table_spec : forall k M i j, (i < k)%nat -> (j < k)%nat -> matrix (table k M) i j == M i j.
Proof.
  intros k M i j Hi Hj. unfold matrix, table. rewrite nth_table by exact Hi. rewrite nth_table by exact Hj.
  apply Qred_correct.
Qed.

Lemma short_sum_spec : forall k f, short_sum k f == sum k f.
Proof.
  induction k as [|k IH]; intros f; [reflexivity|]. cbn [short_sum sum]. cbv zeta.
  destruct (Qeq_bool (f k) 0) eqn:E.
  - apply Qeq_bool_iff in E. rewrite IH, E. ring.
  - rewrite Qred_correct, IH. reflexivity.
Qed.

Lemma derivative_spec : forall k F V S, check_derivative k F V S = true ->
  forall i j, (i < k)%nat -> (j < k)%nat -> S i j == sum k (fun h => F h i * V h j + V i h * F h j).
Proof.
  intros k F V S H i j Hi Hj. unfold check_derivative in H. cbv zeta in H.
  rewrite (same_spec k _ _ H i j Hi Hj), short_sum_spec. apply sum_equal. intros h Hh.
  rewrite !table_spec by assumption. reflexivity.
Qed.

(* For vectors given as lists. *)
Lemma negative_lists : forall k M, negative_definite k M ->
  forall x : list Q, length x = k -> Exists (fun a => ~ a == 0) x -> form k M (fun i => nth i x 0) < 0.
Proof.
  intros k M H x L N. apply H. apply Exists_exists in N. destruct N as [a [Ha N]].
  destruct (In_nth x a 0 Ha) as [i [Hi E]]. exists i. rewrite E. split; [lia | exact N].
Qed.

(*** OVER_R ***)
Import Lra.
Open Scope R_scope.

Lemma sum_R_equal : forall k f g, (forall i, (i < k)%nat -> f i = g i) -> sum_R k f = sum_R k g.
Proof.
  induction k as [|k IH]; intros f g H; simpl; [reflexivity|].
  rewrite (IH f g) by (intros; apply H; lia). rewrite (H k) by lia. reflexivity.
Qed.

Lemma sum_R_add : forall k f g, sum_R k (fun i => f i + g i) = sum_R k f + sum_R k g.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_R_scale : forall k a f, sum_R k (fun i => a * f i) = a * sum_R k f.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_R_zero : forall k f, (forall i, (i < k)%nat -> f i = 0) -> sum_R k f = 0.
Proof.
  induction k as [|k IH]; intros f H; simpl; [reflexivity|].
  rewrite IH by (intros; apply H; lia). rewrite (H k) by lia. ring.
Qed.

Lemma sum_R_single : forall k f p, (p < k)%nat ->
  (forall i, (i < k)%nat -> i <> p -> f i = 0) -> sum_R k f = f p.
Proof.
  induction k as [|k IH]; intros f p Hp H; [lia|]. simpl.
  destruct (Nat.eq_dec p k) as [E|E].
  - subst. rewrite sum_R_zero by (intros; apply H; lia). ring.
  - rewrite (IH f p) by (try lia; intros; apply H; lia). rewrite (H k) by lia. ring.
Qed.

Lemma Q2R_zero : Q2R 0 = 0.
Proof. unfold Q2R. simpl. ring. Qed.

Lemma Q2R_one : Q2R 1 = 1.
Proof. unfold Q2R. simpl. field. Qed.

Lemma Q2R_positive : forall a, (0 < a)%Q -> 0 < Q2R a.
Proof. intros a H. rewrite <- Q2R_zero. apply Qlt_Rlt. exact H. Qed.

Lemma form_R_equal : forall k M N x,
  (forall i j, (i < k)%nat -> (j < k)%nat -> (M i j == N i j)%Q) -> form_R k M x = form_R k N x.
Proof.
  intros k M N x H. unfold form_R. apply sum_R_equal. intros i Hi. apply sum_R_equal. intros j Hj.
  rewrite (Qeq_eqR _ _ (H i j Hi Hj)). reflexivity.
Qed.

Lemma form_R_negated : forall k M x, form_R k (fun i j => (- M i j)%Q) x = - form_R k M x.
Proof.
  intros k M x. unfold form_R.
  rewrite (sum_R_equal k _ (fun i => (-1) * sum_R k (fun j => x i * Q2R (M i j) * x j))).
  - rewrite sum_R_scale. ring.
  - intros i _. rewrite <- sum_R_scale. apply sum_R_equal. intros. rewrite Q2R_opp. ring.
Qed.

Definition value_R (k : nat) (x : nat -> R) (s : square) : R := sum_R k (fun i => Q2R (column s i) * x i).

Definition squares_R (k : nat) (l : list square) (x : nat -> R) : R :=
  fold_right (fun s v => Q2R (weight s) * (value_R k x s * value_R k x s) + v) 0 l.

Lemma form_R_product : forall k l x, form_R k (product l) x = squares_R k l x.
Proof.
  intros k l x. induction l as [|s rest IH].
  - unfold form_R. apply sum_R_zero. intros. apply sum_R_zero. intros. cbn [product]. rewrite Q2R_zero. ring.
  - rewrite (form_R_equal k _ (fun i j => weight s * (column s i * column s j) + product rest i j)%Q)
      by (intros; apply product_step).
    unfold squares_R. cbn [fold_right]. fold (squares_R k rest x). rewrite <- IH. unfold form_R.
    rewrite (sum_R_equal k _ (fun i => Q2R (weight s) * value_R k x s * (Q2R (column s i) * x i)
      + sum_R k (fun j => x i * Q2R (product rest i j) * x j))).
    + rewrite sum_R_add, sum_R_scale. unfold value_R. ring.
    + intros i _. rewrite (sum_R_equal k _ (fun j =>
        (Q2R (weight s) * (Q2R (column s i) * x i)) * (Q2R (column s j) * x j)
        + x i * Q2R (product rest i j) * x j)).
      * rewrite sum_R_add, sum_R_scale. unfold value_R. ring.
      * intros j _. rewrite Q2R_plus, !Q2R_mult. ring.
Qed.

Lemma squares_R_nonnegative : forall k l x, triangular k l = true -> 0 <= squares_R k l x.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H; [apply Rle_refl|].
  destruct (triangular_step k s rest H) as [_ [D [_ T]]]. specialize (IH T).
  apply Q2R_positive in D. unfold squares_R in *. cbn [fold_right]. nra.
Qed.

Lemma squares_R_vanish : forall k l x, triangular k l = true -> squares_R k l x <= 0 ->
  forall i, In i (map pivot l) -> x i = 0.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H Z i Hi; [destruct Hi|].
  destruct (triangular_step k s rest H) as [Hp [D [Later T]]]. apply Q2R_positive in D.
  pose proof (squares_R_nonnegative k rest x T) as N.
  assert (Zr : squares_R k rest x <= 0) by (unfold squares_R in *; cbn [fold_right] in Z; nra).
  assert (Zs : value_R k x s = 0).
  { assert (S : Q2R (weight s) * (value_R k x s * value_R k x s) <= 0)
      by (unfold squares_R in *; cbn [fold_right] in Z; lra).
    apply Rsqr_0_uniq. unfold Rsqr. nra. }
  specialize (IH T Zr). cbn [map] in Hi.
  assert (X : x (pivot s) = 0).
  { unfold value_R in Zs. rewrite (sum_R_single k _ (pivot s) Hp) in Zs.
    - unfold column in Zs. rewrite Nat.eqb_refl in Zs. rewrite Q2R_one, Rmult_1_l in Zs. exact Zs.
    - intros j Hj Other. destruct (Later j Hj) as [E|[E|E]]; [contradiction| |].
      + rewrite (IH j E). ring.
      + rewrite (Qeq_eqR _ _ E), Q2R_zero. ring. }
  destruct Hi as [E|E]; [rewrite <- E; exact X | exact (IH i E)].
Qed.

Theorem check_positive_R : forall k M l, check k M l = true -> positive_definite_R k M.
Proof.
  intros k M l H x [i [Hi N]]. unfold check in H.
  apply andb_prop in H. destruct H as [H E]. apply andb_prop in H. destruct H as [T Pivots].
  rewrite (form_R_equal k M (product l) x (same_spec k M (product l) E)).
  rewrite form_R_product. apply Rnot_le_lt. intros Z. apply N.
  apply (squares_R_vanish k l x T Z). apply member_in. exact (all_below_spec k _ Pivots i Hi).
Qed.

Theorem check_negative_R : forall k M l,
  check k (fun i j => (- M i j)%Q) l = true -> negative_definite_R k M.
Proof.
  intros k M l H x N. pose proof (check_positive_R k _ l H x N) as G. rewrite form_R_negated in G. lra.
Qed.

Lemma derivative_negative_R : forall k F V S, check_derivative k F V S = true -> negative_definite_R k S ->
  negative_definite_R k (fun i j => sum k (fun h => F h i * V h j + V i h * F h j)%Q).
Proof.
  intros k F V S E H x X. rewrite <- (form_R_equal k S _ x (derivative_spec k F V S E)). exact (H x X).
Qed.

Close Scope R_scope.
